"""Compares turnlight's ray hits one by one with Embree's (through embreex).

    cargo build --release --example ray_hits
    python validation/check_hits.py [--rays N] [--json OUT.json] MESH...

Needs numpy, trimesh and embreex. For every mesh, as it is and scaled by 0.01 and 1000:

* random rays, half from a sphere around the mesh and half from inside its box, aimed at random points
  of the box: closest hit and occlusion must be Embree's for 99.999 % of the rays;
* for a closed mesh also rays from outside aimed at its vertices and the middles of its edges: none
  may pass through.

Embree's single-ray traversal itself lets rays slip through edges, so where the two differ, every
triangle is tested in double precision, and only turnlight's mistakes count. A different triangle at
the same distance (an edge between the two, or coincident triangles) is no difference.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

RAY_HITS = Path(__file__).resolve().parent.parent / "target/release/examples/ray_hits"
REQUIRED = 0.99999
RELATIVE_T = 1e-4
# Of the mesh's size: a ray that starts this near to a surface gets no relative accuracy from
# single-precision coordinates.
ABSOLUTE_T = 1e-6


def turnlight_hits(vertices, faces, rays):
    """`(hit, t, triangle, occluded)` of each ray, by turnlight."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [str(Path(folder) / f"{name}.npy") for name in ("positions", "triangles", "rays", "out")]
        for path, array in zip(paths, (vertices, faces.astype(np.uint32), rays)):
            np.save(path, np.ascontiguousarray(array))
        subprocess.run([str(RAY_HITS), *paths], check=True)
        out = np.load(paths[3])
    return out[:, 0] > 0, out[:, 1], out[:, 2].astype(np.int64), out[:, 3] > 0


def embree_hits(vertices, faces, rays):
    """The same by Embree. Distances come from the hit triangle's plane, in double precision."""
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, vertices, faces.astype(np.int32))
    origin, direction = np.ascontiguousarray(rays[:, :3]), np.ascontiguousarray(rays[:, 3:])
    triangle = scene.run(origin, direction, query="INTERSECT")
    occluded = scene.run(origin, direction, query="OCCLUDED") >= 0
    hit = triangle >= 0
    t = np.full(len(rays), np.inf)
    corners = vertices[faces[triangle[hit]]].astype(np.float64)
    t[hit] = plane_distance(corners, rays[hit])[0]
    return hit, t, triangle, occluded


def plane_distance(corners, rays):
    """`t, u, v` where rays meet the planes of triangles (Moller and Trumbore 1997), broadcast."""
    origin, direction = np.split(rays.astype(np.float64), 2, axis=-1)
    a, ab, ac = corners[..., 0, :], corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    p = np.cross(direction, ac)
    determinant = np.sum(ab * p, axis=-1)
    from_a = origin - a
    q = np.cross(from_a, ab)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.sum(ac * q, axis=-1) / determinant
        u = np.sum(from_a * p, axis=-1) / determinant
        v = np.sum(direction * q, axis=-1) / determinant
    return t, u, v


def tolerance(t, vertices):
    return RELATIVE_T * t + ABSOLUTE_T * np.abs(vertices).max()


def exact_verdict(vertices, faces, ray, hit, t):
    """Whether an answer `(hit, t)` can be right, by brute force in double precision.

    Triangles met within `slack` of their border may count or not: single precision decides.
    """
    corners = vertices[faces].astype(np.float64)
    ts, us, vs = plane_distance(corners, ray[None])
    inside = np.minimum(np.minimum(us, vs), 1 - us - vs)
    # Rounding in single precision, in barycentric units of each triangle.
    size = np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2).max(axis=1)
    height = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / size
    reach = np.abs(ray[:3]).max() + np.abs(corners).max()
    with np.errstate(divide="ignore", invalid="ignore"):
        slack = 1e-6 * reach / height
    surely = ts[(ts > ABSOLUTE_T * reach) & (inside > slack)]
    maybe = ts[(ts > -ABSOLUTE_T * reach) & (inside > -slack)]
    nearest = surely.min() if len(surely) else np.inf
    if not hit:
        return not np.isfinite(nearest)
    return t <= nearest + tolerance(t, vertices) and bool(np.any(np.abs(maybe - t) <= tolerance(t, vertices)))


def random_rays(vertices, count, random):
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    centre, radius = (lower + upper) / 2, np.linalg.norm(upper - lower) / 2
    outside = random.normal(size=(count, 3))
    outside = centre + 2 * radius * outside / np.linalg.norm(outside, axis=1, keepdims=True)
    inside = random.uniform(lower, upper, (count, 3))
    origin = np.where(np.arange(count)[:, None] % 2 == 0, outside, inside)
    return towards(origin, random.uniform(lower, upper, (count, 3)))


def border_rays(vertices, faces, count, random):
    """Rays from outside at vertices and middles of edges, and the two vertices of each target."""
    ends = faces[random.integers(len(faces), size=count)][:, :2]
    ends[::2, 1] = ends[::2, 0]
    target = (vertices[ends[:, 0]] + vertices[ends[:, 1]]) / np.float32(2)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    centre, radius = (lower + upper) / 2, np.linalg.norm(upper - lower) / 2
    outside = random.normal(size=(count, 3))
    outside = centre + 2 * radius * outside / np.linalg.norm(outside, axis=1, keepdims=True)
    return towards(outside, target), target, ends


def towards(origin, target):
    origin = origin.astype(np.float32)
    direction = target.astype(np.float32).astype(np.float64) - origin
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-30)
    return np.hstack([origin, direction.astype(np.float32)])


def check_random(vertices, faces, count, random):
    rays = random_rays(vertices, count, random)
    hit, t, triangle, occluded = turnlight_hits(vertices, faces, rays)
    e_hit, e_t, e_triangle, e_occluded = embree_hits(vertices, faces, rays)
    with np.errstate(invalid="ignore"):
        same_t = np.abs(t - e_t) <= tolerance(t, vertices)
    same = (hit == e_hit) & (~hit | same_t) & (occluded == e_occluded)
    differing = np.flatnonzero(~same)
    judged = differing[:2000]
    wrong = sum(
        occluded[i] != hit[i] or not exact_verdict(vertices, faces, rays[i], hit[i], t[i]) for i in judged
    )
    embree_wrong = sum(not exact_verdict(vertices, faces, rays[i], e_hit[i], e_t[i]) for i in judged)
    # Differences beyond the first 2000 count as turnlight's.
    wrong += len(differing) - len(judged)
    return {
        "rays": count,
        "hits": int(hit.sum()),
        "differ_from_embree": len(differing),
        "other_triangle_same_t": int(np.sum(same & hit & (triangle != e_triangle))),
        "turnlight_wrong": int(wrong),
        "embree_wrong": int(embree_wrong),
        "agreement": 1 - wrong / count,
        "passed": bool(1 - wrong / count >= REQUIRED),
    }


def check_watertight(vertices, faces, vertex_faces, count, random):
    """A ray leaks if it hits nothing, or only something well behind its target."""
    rays, target, ends = border_rays(vertices, faces, count, random)
    # At a silhouette a ray may rightly pass.
    judged = ~at_silhouette(vertices, faces, vertex_faces, rays, ends)
    rays, target = rays[judged], target[judged]
    limit = np.linalg.norm(target - rays[:, :3].astype(np.float64), axis=1)
    limit += 1e-3 * np.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0))
    hit, t, _, occluded = turnlight_hits(vertices, faces, rays)
    e_hit, e_t, _, e_occluded = embree_hits(vertices, faces, rays)
    leaks = ~hit | ~occluded | (t > limit)
    return {
        "rays": len(rays),
        "leaks": int(leaks.sum()),
        "embree_leaks": int((~e_hit | ~e_occluded | (e_t > limit)).sum()),
        "passed": not leaks.any(),
    }


def at_silhouette(vertices, faces, vertex_faces, rays, ends):
    """Whether some triangles around either end face the ray and others don't, or one is edge on."""
    corners = vertices[faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(length > 0, length, 1)
    towards_all = np.full(len(rays), True)
    away_all = np.full(len(rays), True)
    for table in vertex_faces.T:
        for end in ends.T:
            face = table[end]
            cosine = np.sum(normals[face] * rays[:, 3:], axis=1)
            towards_all &= (face < 0) | (cosine < -0.05)
            away_all &= (face < 0) | (cosine > 0.05)
    return ~(towards_all | away_all)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("meshes", nargs="+", help="any file trimesh loads, or icosphere:LEVELS")
    parser.add_argument("--rays", type=int, default=1_000_000)
    parser.add_argument("--json", help="also write the numbers here")
    arguments = parser.parse_args()
    results, passed = [], True
    print(f"{'mesh':<24} {'scale':>6} {'test':<10} {'rays':>9} {'differ':>7} {'wrong':>6} {'Embree wrong':>12}  result")
    for name in arguments.meshes:
        if name.startswith("icosphere:"):
            mesh = trimesh.creation.icosphere(int(name.split(":")[1]))
        else:
            mesh = trimesh.load(name, force="mesh")
        merged = trimesh.Trimesh(mesh.vertices.astype(np.float32), mesh.faces, process=False)
        merged.merge_vertices(merge_tex=True, merge_norm=True)
        for scale in (1.0, 0.01, 1000.0):
            vertices = (np.asarray(merged.vertices) * scale).astype(np.float32)
            faces = np.asarray(merged.faces)
            random = np.random.default_rng(1)
            tests = [("random", check_random(vertices, faces, arguments.rays, random))]
            if merged.is_watertight:
                tests.append(("border", check_watertight(vertices, faces, merged.vertex_faces, arguments.rays, random)))
            for test, result in tests:
                passed &= result["passed"]
                results.append({"mesh": name, "triangles": len(faces), "scale": scale, "test": test, **result})
                print(
                    f"{Path(name).name:<24} {scale:>6g} {test:<10} {result['rays']:>9}"
                    f" {result.get('differ_from_embree', 0):>7}"
                    f" {result.get('turnlight_wrong', result.get('leaks')):>6}"
                    f" {result.get('embree_wrong', result.get('embree_leaks')):>12}"
                    f"  {'passed' if result['passed'] else 'FAILED'}",
                    flush=True,
                )
    if arguments.json:
        Path(arguments.json).write_text(json.dumps({"passed": passed, "results": results}, indent=1) + "\n")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
