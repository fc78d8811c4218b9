"""Does turnlight calibrate as OpenCV does, and read what OpenCV writes?

    target/validation/venv/bin/python validation/check_calibration.py [--quick] [--json FILE]

Three comparisons on OpenCV's thirteen chessboard photographs (../shared/data beside the project;
skipped where it is absent) and on drawn boards whose lens is known:

* solver: both from OpenCV's corners. The same minimum: root mean square, lens and its standard
  deviations.
* detector: turnlight's own corners against OpenCV's (findChessboardCorners, cornerSubPix).
  cornerSubPix looks at a window about each corner; one that reaches the next corner (as the
  customary one of half size 11 does in some of these photographs) moves corners by up to six
  pixels. OpenCV is given the window, of half size 3 to 11, whose root mean square is least, and the
  figures of the customary one are printed beside it, and those that OpenCV publishes with the
  photographs (left_intrinsics.yml), which are the customary window's. Where these are off by more than
  0.5 %, the moved corners should be to blame: OpenCV calibrates from its customary corners once more,
  without those more than half a pixel off.
* files: a lens that OpenCV's FileStorage writes as YAML, XML and JSON reads back.

Bars: solver: root mean square and lens to 1e-5, standard deviations to 1 %. Detector: every board is
found; root mean square at most 1.05 times OpenCV's, focal lengths within 0.5 % of its best window's and
of its customary one's without the moved corners; on drawn boards they are also within 0.5 % of the truth.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "target/release/turnlight"
PHOTOGRAPHS = ROOT.parent / "shared/data/calibration/opencv_stereo"
BOARD = (9, 6)
WINDOWS = range(3, 12)
MOVED = 0.5  # pixels; the root mean square of the others is 0.18
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


def board_points(board):
    columns, rows = board
    points = np.zeros((columns * rows, 3), np.float32)
    points[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2)
    return points


def opencv_corners(paths, board, windows):
    """For every window's half size, by name of photograph: [N, 2] pixels, the first pixel's centre at 0."""
    found = {window: {} for window in windows}
    for path in paths:
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        seen, rough = cv2.findChessboardCorners(grey, board)
        if not seen:
            continue
        criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
        for window, all_corners in found.items():
            corners = cv2.cornerSubPix(grey, rough.copy(), (window, window), (-1, -1), criteria)
            all_corners[path.name] = corners.reshape(-1, 2)
    return found


def opencv_calibrate(corners, board, size):
    points = board_points(board)
    seen = [c.astype(np.float32)[:, None] for c in corners.values()]
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 500, 1e-14)
    rms, k, d, _, _, deviations, *_ = cv2.calibrateCameraExtended(
        [points] * len(seen), seen, size, None, None, criteria=criteria
    )
    lens = [k[0, 0], k[1, 1], k[0, 2] + 0.5, k[1, 2] + 0.5, *d.ravel()[:5]]
    return rms, np.array(lens), deviations.ravel()[:9]


def published_focal(path):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    return float(storage.getNode("camera_matrix").mat()[0, 0])


def without_moved_corners(corners, board, size):
    """The lens's focal lengths, and how many corners are left out: those more than MOVED pixels off, by turns."""
    points = board_points(board)
    kept = {name: np.ones(len(c), bool) for name, c in corners.items()}
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 500, 1e-14)
    for turn in range(10):
        seen = [points[kept[name]] for name in corners]
        pixels = [c[kept[name]].astype(np.float32)[:, None] for name, c in corners.items()]
        _, k, d, rotations, translations = cv2.calibrateCamera(
            seen, pixels, size, None, None, criteria=criteria
        )
        off = {}
        for (name, c), r, t in zip(corners.items(), rotations, translations):
            off[name] = np.linalg.norm(cv2.projectPoints(points, r, t, k, d)[0][:, 0] - c, axis=1)
        # The first calibrations are bent by what is to be left out.
        limit = MOVED if turn > 2 else 2 * MOVED
        last, kept = kept, {name: e <= limit for name, e in off.items()}
        if turn > 3 and all((last[name] == kept[name]).all() for name in kept):
            break
    return np.array([k[0, 0], k[1, 1]]), int(sum((~k).sum() for k in last.values()))


def turnlight(*arguments):
    command = [str(PROGRAM), "--quiet", "camera", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")


def turnlight_calibrate(folder, *arguments):
    report = Path(folder) / "report.json"
    turnlight("calibrate", *arguments, "--out", Path(folder) / "camera.toml", "--report", report)
    with open(report) as file:
        found = json.load(file)
    values = [[found["parameters"][name][key] for name in NAMES] for key in ("value", "sigma")]
    return found["rms_px"], np.array(values[0]), np.array(values[1]), found


def corner_file(path, corners, board, size):
    columns = board_points(board)[:, :2]
    photographs = [
        {"name": name, "corners": np.hstack([columns, c]).astype(float).tolist()}
        for name, c in corners.items()
    ]
    written = {
        "width": size[0],
        "height": size[1],
        "first_pixel_centre": 0.0,
        "photographs": photographs,
    }
    path.write_text(json.dumps(written))


def draw_board(lens, size, rotation, translation, board, rng):
    """A photograph of a board under a known lens: blurred by its pixels, with noise, eight bits."""
    fx, fy, cx, cy = lens[:4]
    over = 3
    grid = (np.arange(over) + 0.5) / over
    x = (np.arange(size[0])[:, None] + grid).ravel()
    y = (np.arange(size[1])[:, None] + grid).ravel()
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 1, 2)
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-10)
    ideal = cv2.undistortPoints(pixels, matrix, lens[4:], None, None, None, criteria)
    rays = np.concatenate([ideal[:, 0], np.ones((len(ideal), 1))], axis=1)
    # The board's plane: p = R (X, Y, 0) + t.
    normal = rotation[:, 2]
    points = rays * ((normal @ translation) / (rays @ normal))[:, None] - translation
    u, v = points @ rotation[:, 0], points @ rotation[:, 1]
    columns, rows = board
    inside = (u > -1) & (u < columns) & (v > -1) & (v < rows)
    dark = inside & ((np.floor(u) + np.floor(v)) % 2 == 0)
    light = np.where(dark, 30.0, 210.0).reshape(size[1], over, size[0], over).mean(axis=(1, 3))
    light = cv2.GaussianBlur(light, (0, 0), 0.7)
    return np.clip(light + rng.normal(0, 2, light.shape), 0, 255).round().astype(np.uint8)


def drawn_boards(folder, size, lens, count, rng):
    paths = []
    for i in range(count):
        around = 2.4 * i
        lean = np.radians(15 + 20 * rng.random()) * np.array([np.cos(around), np.sin(around), 0.0])
        rotation = cv2.Rodrigues(lean)[0] @ cv2.Rodrigues(np.array([0, 0, 0.25 * (i % 5 - 2)]))[0]
        away = np.array([2.2 * np.cos(1.7 * around), 1.5 * np.sin(1.3 * around), 12.5])
        translation = away - rotation @ np.array([4.0, 2.5, 0.0])
        image = draw_board(lens, size, rotation, translation, BOARD, rng)
        path = Path(folder) / f"drawn{i:02}.png"
        cv2.imwrite(str(path), image)
        paths.append(path)
    return paths


def check_solver(name, corners, size, rows):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "corners.json"
        corner_file(path, corners, BOARD, size)
        rms, lens, sigma, _ = turnlight_calibrate(folder, "--corners", path)
    peer_rms, peer_lens, peer_sigma = opencv_calibrate(corners, BOARD, size)
    scale = np.array([*peer_lens[:2], *peer_lens[:2], 1, 1, 1, 1, 1])
    differences = {
        "rms": abs(rms / peer_rms - 1),
        "lens": float((np.abs(lens - peer_lens) / scale).max()),
        "sigma": float(np.abs(sigma / peer_sigma - 1).max()),
    }
    passed = differences["rms"] < 1e-5 and differences["lens"] < 1e-5 and differences["sigma"] < 0.01
    print(
        f"solver   {name:28} rms {rms:.5f} px; from OpenCV's: rms {differences['rms']:.1e}, "
        f"lens {differences['lens']:.1e}, sigma {differences['sigma']:.1e}{'' if passed else '  FAIL'}"
    )
    rows.append({"check": "solver", "case": name, "rms_px": rms, **differences, "passed": passed})


def check_detector(name, paths, size, rows, truth=None, published=None):
    with tempfile.TemporaryDirectory() as folder:
        rms, lens, sigma, report = turnlight_calibrate(folder, *paths, "--board", "9x6")
    seen = opencv_corners(paths, BOARD, WINDOWS)
    peers = {window: opencv_calibrate(corners, BOARD, size) for window, corners in seen.items()}
    window = min(peers, key=lambda w: peers[w][0])
    peer_rms, peer_lens, _ = peers[window]
    found = len(report["photographs"])
    focal = float(np.abs(lens[:2] / peer_lens[:2] - 1).max())
    row = {
        "check": "detector",
        "case": name,
        "boards": found,
        "rms_px": rms,
        "opencv_window": window,
        "opencv_rms_px": peer_rms,
        "opencv_customary_rms_px": peers[11][0],
        "focal_difference": focal,
    }
    sound, moved = without_moved_corners(seen[11], BOARD, size)
    row["opencv_moved_corners"] = moved
    row["focal_difference_without_moved"] = float(np.abs(lens[:2] / sound - 1).max())
    row["focal_difference_customary"] = float(np.abs(lens[:2] / peers[11][1][:2] - 1).max())
    passed = found == len(paths) and rms <= 1.05 * peer_rms and focal <= 0.005
    passed = passed and row["focal_difference_without_moved"] <= 0.005
    text = f"rms {rms:.4f} px, OpenCV {peer_rms:.4f}; fx {lens[0]:.2f}, OpenCV {peer_lens[0]:.2f}"
    if truth is not None:
        row["focal_error"] = float(np.abs(lens[:2] / truth[:2] - 1).max())
        row["z"] = ((lens - truth) / sigma).tolist()
        passed = passed and row["focal_error"] <= 0.005
        text += f", truth {truth[0]:.2f} (z {row['z'][0]:.1f})"
    row["passed"] = bool(passed)
    print(
        f"detector {name:28} {found} of {len(paths)} boards; {text}; focal {100 * focal:.3f} %"
        f"{'' if passed else '  FAIL'}"
    )
    print(
        f"         OpenCV's window {window}; with the customary 11: rms {peers[11][0]:.4f} px, "
        f"fx {peers[11][1][0]:.2f} (focal {100 * row['focal_difference_customary']:.3f} %), without its "
        f"{moved} moved corners {sound[0]:.2f} ({100 * row['focal_difference_without_moved']:.3f} %)"
    )
    if published is not None:
        row["focal_difference_published"] = abs(lens[0] / published - 1)
        print(
            f"         OpenCV's published fx {published:.2f}: focal "
            f"{100 * row['focal_difference_published']:.3f} %"
        )
    rows.append(row)


def check_files(rows):
    matrix = np.array([[536.07, 0, 342.37], [0, 536.01, 235.53], [0, 0, 1]])
    distortion = np.array([-0.26, -0.04, 0.0018, -0.0003, 0.25])
    expected = [536.07, 536.01, 342.87, 236.03, *distortion]
    for ending in ("yml", "xml", "json"):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"lens.{ending}"
            storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
            storage.write("image_width", 640)
            storage.write("image_height", 480)
            storage.write("camera_matrix", matrix)
            storage.write("distortion_coefficients", distortion)
            storage.release()
            out = Path(folder) / "camera.toml"
            turnlight("import", path, "--out", out)
            lines = dict(
                line.split(" = ", 1) for line in out.read_text().splitlines() if " = " in line
            )
        read = [json.loads(lines[key]) for key in ("fx", "fy", "cx", "cy")]
        read += json.loads(lines["distortion"])
        difference = float(np.abs(np.array(read) - expected).max())
        passed = difference < 1e-12
        print(f"files    {ending:28} off by {difference:.1e}{'' if passed else '  FAIL'}")
        rows.append({"check": "files", "case": ending, "off": difference, "passed": passed})


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one set of drawn boards instead of six")
    parser.add_argument("--json", metavar="FILE", help="write the table as JSON")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    rows = []
    check_files(rows)
    paths = sorted(PHOTOGRAPHS.glob("left*.jpg"))
    if paths:
        size = (640, 480)
        for window, corners in opencv_corners(paths, BOARD, (5, 11)).items():
            check_solver(f"photographs, window {window}", corners, size, rows)
        published = published_focal(PHOTOGRAPHS / "left_intrinsics.yml")
        check_detector("photographs", paths, size, rows, published=published)
    else:
        print(f"no photographs in {PHOTOGRAPHS}: drawn boards only")
    for case in range(1 if options.quick else 6):
        size = (960, 720)
        focal = rng.uniform(800, 1100)
        lens = np.array([focal, 1.01 * focal, 487.0, 355.5, -0.15, 0.05, 1e-3, -5e-4, 0.0])
        with tempfile.TemporaryDirectory() as folder:
            paths = drawn_boards(folder, size, lens, 12, rng)
            check_detector(f"drawn boards {case}", paths, size, rows, lens)
            check_solver(f"drawn boards {case}", opencv_corners(paths, BOARD, (5,))[5], size, rows)
    failed = sum(not row["passed"] for row in rows)
    print(f"OpenCV {cv2.__version__}; {len(rows) - failed} checks passed, {failed} failed")
    if options.json:
        with open(options.json, "w") as file:
            json.dump({"seed": options.seed, "checks": rows}, file, indent=1)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
