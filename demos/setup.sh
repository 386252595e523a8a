# shellcheck shell=bash disable=SC2154 # whoever sources this has set `root`
# Installation of the Python environment; sourced by demos/run.sh and tests/run.sh, which set `root` to the project folder.
#
# set_up   installs what is missing: Debian packages and root/.venv, an environment that uses Debian's DOLFINx; with
#          RECEDING_ENV=pypi root/.venv-pypi, an environment of PyPI wheels only. A set-up that was stopped is done again.
# It sets  $venv, its interpreter $python, and $mpirun, which starts MPI programs.

# Libraries of PyPI's gmsh, and of VTK for off-screen rendering:
graphics="libosmesa6 libgl1 libglu1-mesa libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1"
# Without libopenblas0-pthread MUMPS is 3 to 5 times slower.
debian_packages="python3-dolfinx-real python3-h5py python3-venv ca-certificates libopenblas0-pthread $graphics"

# Test of a new environment: imports, and compilation of a form and of the event loop of the exact path.
works='
from receding_fenicsx.bulk.elasticity import warm_up
from receding_fenicsx.interface.exact.compilation import warm_up as compile_path
import PIL, gmsh, h5py, matplotlib, pandas, pytest, scipy, vtk, xarray
warm_up()
compile_path()'

say() { printf '%s: %s\n' "$(basename "$0")" "$*" >&2; }
die() { say "$@" && exit 1; }
unavailable() { say "$@" && exit 69; } # this machine lacks a requirement; nothing is wrong with the project

set_up() {
    # Settings of the user that would take precedence over this environment
    unset PYTHONPATH PYTHONHOME PIP_TARGET PIP_PREFIX
    export PYTHONNOUSERSITE=1 PIP_USER=0 PIP_REQUIRE_VIRTUALENV=0 PIP_DISABLE_PIP_VERSION_CHECK=1
    # One BLAS thread per rank: on small dense systems more threads are up to 70 times slower.
    export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
    # Open MPI: allow root and more ranks than cores, bind no rank to a core, yield the core while waiting, and do not read
    # the memory of another process directly, which containers forbid.
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1
    export OMPI_MCA_hwloc_base_binding_policy=none OMPI_MCA_mpi_yield_when_idle=1 OMPI_MCA_btl_vader_single_copy_mechanism=none
    case ${RECEDING_ENV:-debian} in
        debian)
            # Debian's DOLFINx works with this interpreter, and this MPI; `mpirun` may belong to another one
            venv=$root/.venv base_python=/usr/bin/python3 mpirun=/usr/bin/mpirun.openmpi venv_options=(--system-site-packages)
            install_debian_packages
            [ -x "$mpirun" ] || mpirun=/usr/bin/mpirun
            ;;
        pypi)
            venv=$root/.venv-pypi mpirun=$root/.venv-pypi/bin/mpiexec venv_options=()
            base_python=$(find_new_python) || unavailable "PyPI's DOLFINx needs Python >= 3.12 with venv, on PATH or among" \
                "pyenv's versions. Install one: 'pyenv install 3.13', or Debian 13's python3-venv and python3-dev"
            command -v "${CC:-cc}" >/dev/null || unavailable "DOLFINx needs a C compiler (${CC:-cc}). Install gcc, or set CC"
            ;;
        *) die "RECEDING_ENV=$RECEDING_ENV is unknown; use debian (default) or pypi" ;;
    esac
    python=$venv/bin/python
    is_complete || build_environment
}

# Prints the oldest Python >= 3.12 that can create environments, or nothing; the newest may have no wheels yet.
find_new_python() {
    for candidate in python3 python3.{12..19} "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3.*/bin/python; do
        # a name without a slash may be a pyenv shim of a version that is not selected: run it to find out
        "$candidate" -I -c 'import sys, venv, ensurepip; v = sys.version_info
if v >= (3, 12) and v.releaselevel == "final": print(*v[:3], sys.executable)' 2>/dev/null </dev/null || true
    done | sort -V | head -n 1 | cut -d ' ' -f 4- | grep .
}

# Prints the Debian packages that are not installed.
missing_packages() {
    local package
    for package in $debian_packages; do
        dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null | grep -qx installed || printf '%s\n' "$package"
    done
}

install_debian_packages() {
    local missing become=sudo apt="apt-get -q -o DPkg::Lock::Timeout=300"
    command -v apt-get >/dev/null || die "apt was not found; this script supports Debian 12 and similar systems. Elsewhere set" \
        "RECEDING_ENV=pypi, which needs Python >= 3.12, or install DOLFINx yourself and run 'pip install .' beside it"
    missing=$(missing_packages | xargs)
    [ -n "$missing" ] || return 0
    [ "$(id -u)" -ne 0 ] || become="env"
    say "installing Debian packages (up to 3 GB, 1 to 2 minutes): $missing"
    # An interrupted installation is finished first; whether the update fails matters only if the installation does.
    $become sh -c "export DEBIAN_FRONTEND=noninteractive; dpkg --configure -a; $apt update
        $apt -y install --no-install-recommends $missing" >&2 </dev/null ||
        die "the Debian packages could not be installed (messages above). Is this Debian 12, and is there a network? If you are" \
            "not permitted to, ask an administrator to run: apt-get install --no-install-recommends $missing"
}

# The mark of a complete environment holds a hash of what it depends on: this script, the package part of pyproject.toml,
# the interpreter and the folder.
environment_key() {
    {
        cat "$root/demos/setup.sh"
        sed '/^# What follows configures tools only/,$d' "$root/pyproject.toml"
        readlink -f "$base_python"
        printf '%s\n' "$root"
    } | sha256sum
}
is_complete() { [ -x "$python" ] && [ "$(cat "$venv/complete" 2>/dev/null)" = "$(environment_key)" ]; }

build_environment() {
    local log=$venv/tmp/log
    [ -w "$root" ] || die "$root is not writable; clone the project into a folder of your own"
    exec 9>"$venv.lock" # held by pip too, which may outlive a set-up that was killed
    flock -n 9 || { say "another set-up is running in $root; waiting for it" && flock 9; }
    if ! is_complete; then
        say "creating the Python environment ${venv##*/} (1 GB from the network, about a minute)"
        rm -rf "$venv"
        "$base_python" -I -m venv "${venv_options[@]}" "$venv" || die "could not create $venv; is the disk full?"
        mkdir "$venv/tmp"
        if ! TMPDIR=$venv/tmp "$python" -m pip install --retries 2 --editable "${root}[test,dev,dolfinx]" >"$log" 2>&1 </dev/null; then
            grep -E '^ *(ERROR|error):|No space left|Connection|Temporary failure' "$log" | tail -n 4 >&2 || true
            unavailable "pip could not install the Python packages (messages in $log). Check the network, the proxy or index" \
                "(PIP_INDEX_URL) and the disk space"
        elif ! "$python" -c "$works" >"$log" 2>&1 </dev/null; then
            ! grep -q 'shared object file' "$log" || unavailable "a library is missing: $(tail -n 1 "$log"). Install: $graphics"
            die "the new Python environment does not work: $(tail -n 1 "$log")"
        fi
        rm -rf "$venv/tmp"
        environment_key >"$venv/complete.part" && mv "$venv/complete.part" "$venv/complete"
    fi
    exec 9>&-
}
