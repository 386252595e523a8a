#!/usr/bin/env bash
# Installs what is missing, then runs a demo on two ranks.
set -euo pipefail

usage="usage: bash demos/run.sh                    install what is missing, then run the paper's study (demos/block.py)
       bash demos/run.sh NAME [options]     run demos/NAME.py, or one of demos/benchmarks, instead
       bash demos/run.sh --setup            install only
Demos run under mpirun -n 2. RECEDING_ENV=pypi bash demos/run.sh uses packages from PyPI instead of Debian."

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
# shellcheck source=demos/setup.sh
source "$root/demos/setup.sh"

case ${1-} in
    -h | --help)
        printf '%s\n' "$usage"
        exit
        ;;
    --setup)
        if [ $# -gt 1 ]; then
            say "--setup takes no other argument, got: ${*:2}"
            exit 2
        fi
        set_up
        printf 'ready: %s\n' "$venv"
        exit
        ;;
    -*)
        printf '%s\n' "$usage" >&2
        say "options must follow the demo's name, got: $1"
        exit 2
        ;;
esac

name=${1:-block}
name=$(basename "$name" .py)
demo=$root/demos/$name.py
[ -f "$demo" ] || demo=$root/demos/benchmarks/$name.py
if [ ! -f "$demo" ]; then
    shopt -s nullglob
    names=("$root"/demos/*.py "$root"/demos/benchmarks/*.py)
    names=("${names[@]##*/}")
    say "no such demo: $name; available: ${names[*]%.py}"
    exit 2
fi
set_up
exec "$mpirun" -n 2 "$python" "$demo" "${@:2}"
