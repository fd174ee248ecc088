#!/usr/bin/env bash
# The default tests with the oldest versions of the direct dependencies that pyproject.toml allows:
# `tests/oldest.sh`; with another Python: `tests/oldest.sh 3.13 highest`. Needs `uv`, or installs it.
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
python=${1:-3.11}
versions=${2:-lowest-direct}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
uv=$(command -v uv || true)
if [ -z "$uv" ]; then
  python3 -m venv "$work/tools"
  "$work/tools/bin/pip" install -q uv
  uv="$work/tools/bin/uv"
fi
cd "$here"
"$uv" venv -q --python "$python" "$work/venv"
VIRTUAL_ENV="$work/venv" "$uv" pip install -q --resolution "$versions" -e ".[test]"
VIRTUAL_ENV="$work/venv" "$uv" pip list
quiet=()
if [ "$versions" != highest ]; then
  # what old versions ask of the newest of their own dependencies, and of how numpy was built
  quiet=(-W ignore::DeprecationWarning -W "ignore:numpy.ndarray size changed:RuntimeWarning")
fi
"$work/venv/bin/python" -m pytest -n auto "${quiet[@]}" "${@:3}"
