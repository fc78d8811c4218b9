#!/usr/bin/env bash
# Everything that must hold: format, lints, documentation, architecture, laws, and small versions of the
# checks against Mitsuba and Embree. About 15 minutes on two cores.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo fmt --check
cargo clippy --release --all-targets --quiet -- -D warnings
RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --quiet
cargo test --release
bash validation/run.sh --quick
