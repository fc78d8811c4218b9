#!/usr/bin/env bash
# Every check of turnlight against its peers, Mitsuba 3 and Embree:
#
#     validation/run.sh [--quick]
#
# Installs what they need (setup.sh), builds turnlight, and exits with 1 if a check failed. The
# tables are left as JSON in target/validation. A full run takes hours; what it has of
# check_images and of Mitsuba's images for check_fit is kept, so it can be interrupted.
set -uo pipefail

validation=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(dirname "$validation")
home=$root/target/validation
quick=()
rays=1000000
case "${1-}" in
    "") ;;
    --quick) quick=(--quick) rays=100000 ;;
    *)
        echo "usage: validation/run.sh [--quick]" >&2
        exit 2
        ;;
esac

"$validation/setup.sh" || exit 2
# Not every path of a script is run here: names that it lacks would show months later.
"$home/venv/bin/python" -m pyflakes "$validation"/*.py || exit 1
(cd "$root" && cargo build --release --quiet --bin turnlight --example ray_hits) || exit 2

passed=0
failed=0
check() { # NAME ARGUMENTS...
    local name=$1
    shift
    echo "== $name"
    if "$home/venv/bin/python" "$validation/$name.py" "$@" --json "$home/$name${quick:+-quick}.json"; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        echo "== $name FAILED"
    fi
}

meshes=("$root/scenes/meshes/suzanne.ply" "$root/scenes/meshes/cup.ply")
helmet=$root/../shared/data/meshes/flighthelmet/FlightHelmet.gltf # 95k triangles, if it is there
[ -f "$helmet" ] && meshes+=("$helmet")

check check_brdf "${quick[@]}"
check check_probe "${quick[@]}"
check check_calibration "${quick[@]}"
check check_probe_merge "${quick[@]}"
check check_hits --rays "$rays" "${meshes[@]}"
check check_images "${quick[@]}"
check check_target_error "${quick[@]}"
check check_fit "${quick[@]}"
# Not in the quick list: dielectrics miss their bar.
[ ${#quick[@]} -gt 0 ] || check check_metals

echo "$passed passed, $failed failed"
[ "$failed" -eq 0 ]
