#!/usr/bin/env bash
# Installs what is missing, then runs the tests on one rank and on two. Arguments are passed to pytest.
# RECEDING_ENV=pypi uses packages from PyPI instead of Debian.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
# shellcheck source=demos/setup.sh
source "$root/demos/setup.sh"

set_up
cd "$root"
[ -t 1 ] || export PY_COLORS=0 # mpirun gives the ranks a terminal of its own
status=0
printf 'tests on 1 rank\n'
"$python" -m pytest --durations=5 "$@" || status=$?
printf '\ntests on 2 ranks\n'
"$mpirun" -n 2 "$python" -m pytest --durations=5 "$@" || status=$?
exit "$status"
