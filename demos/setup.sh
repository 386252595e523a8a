# shellcheck shell=bash
# shellcheck disable=SC2154 # whoever sources it has set `root`
# Installation of the Python environment; sourced by demos/run.sh and tests/run.sh, which set `root` to the project folder.
#
# set_up   installs what is missing: Debian packages and root/.venv, an environment that uses Debian's DOLFINx; with
#          RECEDING_ENV=pypi root/.venv-pypi, an environment of PyPI wheels only.
# It sets  $python, the environment's interpreter, and $mpirun, which starts MPI programs.

# Libraries of PyPI's gmsh, and of VTK for off-screen rendering:
graphics_packages=(
    libosmesa6 libgl1 libglu1-mesa libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1
)
debian_packages=(
    python3-dolfinx-real python3-h5py python3-venv ca-certificates
    libopenblas0-pthread # without it MUMPS is 3 to 5 times slower
    "${graphics_packages[@]}"
)

# Test of a new environment: imports, and compilation of a form and of the event loop of the exact path.
works='
from receding_fenicsx.bulk.elasticity import warm_up
from receding_fenicsx.interface.exact.compilation import warm_up as compile_path
import PIL, gmsh, h5py, matplotlib, pandas, pytest, scipy, vtk, xarray
from mpi4py import MPI
warm_up(MPI.COMM_SELF, "triangle", 1)
compile_path()'

say() { printf '%s: %s\n' "$(basename "$0")" "$*" >&2; }

die() {
    say "$@"
    exit 1
}

# Ends with exit code 69: this machine lacks a requirement; nothing is wrong with the project.
unavailable() {
    say "$@"
    exit 69
}

set_up() {
    case ${RECEDING_ENV:-debian} in
        debian) set_up_debian ;;
        pypi) set_up_pypi ;;
        *) die "RECEDING_ENV=$RECEDING_ENV is unknown; use debian (default) or pypi" ;;
    esac
    # PYTHONPATH and packages in the user's home would take precedence over this environment.
    unset PYTHONPATH PYTHONHOME
    export PYTHONNOUSERSITE=1
    # One BLAS thread per rank: on small dense systems more threads are up to 70 times slower.
    export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
    # Open MPI: allow root and more ranks than cores, bind no rank to a core, yield the core while waiting, and do not read
    # the memory of another process directly, which containers forbid.
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    export OMPI_MCA_rmaps_base_oversubscribe=1 OMPI_MCA_hwloc_base_binding_policy=none
    export OMPI_MCA_mpi_yield_when_idle=1
    export OMPI_MCA_btl_vader_single_copy_mechanism=none
}

set_up_debian() {
    venv=$root/.venv
    base_python=/usr/bin/python3 # Debian's DOLFINx works with this interpreter only
    venv_options=(--system-site-packages)
    base_imports='import venv, ensurepip, mpi4py.MPI, petsc4py.PETSc, dolfinx'
    install_debian_packages
    ensure_environment
    mpirun=/usr/bin/mpirun.openmpi # the MPI of Debian's DOLFINx; `mpirun` may belong to another one
    [ -x "$mpirun" ] || mpirun=/usr/bin/mpirun
}

set_up_pypi() {
    venv=$root/.venv-pypi
    base_python=$(find_new_python) || unavailable "PyPI's DOLFINx needs Python >= 3.12 with venv and ensurepip; none is on" \
        "PATH or among pyenv's versions. Install one: 'pyenv install 3.13', or Debian 13's python3-venv and python3-dev"
    venv_options=()
    base_imports='import venv, ensurepip'
    command -v "${CC:-cc}" >/dev/null ||
        unavailable "no C compiler found (${CC:-cc}); DOLFINx needs one to compile its forms. Install gcc, or set CC"
    ensure_environment
    mpirun=$venv/bin/mpiexec # PyPI's MPI needs its own mpiexec
}

# Prints the oldest Python >= 3.12 that can create environments, or nothing; the newest may have no wheels yet.
find_new_python() {
    local candidate
    for candidate in python3 python3.{12..19} "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3.*/bin/python; do
        # a name without a slash may be a pyenv shim of a version that is not selected: run it to find out
        "$candidate" -I -c 'if True:
            import sys, venv, ensurepip
            if sys.version_info >= (3, 12) and sys.version_info.releaselevel == "final":
                print(*sys.version_info[:3], sys.executable)' 2>/dev/null </dev/null || true
    done | sort -k1,1n -k2,2n -k3,3n | head -n 1 | cut -d ' ' -f 4- | grep .
}

# Prints the Debian packages that are not installed.
missing_packages() {
    comm -23 <(printf '%s\n' "${debian_packages[@]}" | sort) <(
        dpkg-query -W -f '${db:Status-Status} ${Package}\n' "${debian_packages[@]}" 2>/dev/null |
            sed -n 's/^installed //p' | sort
    )
}

install_debian_packages() {
    local missing become=() command
    if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
        die "apt was not found; this script supports Debian 12 and similar systems. Elsewhere set RECEDING_ENV=pypi, which" \
            "needs Python >= 3.12, or install DOLFINx in a Python environment of your own and run 'pip install .' in it"
    fi
    mapfile -t missing < <(missing_packages)
    [ ${#missing[@]} -gt 0 ] || return 0
    command="apt-get install --no-install-recommends ${missing[*]}"
    if [ "$(id -u)" -ne 0 ]; then
        if ! command -v sudo >/dev/null; then
            die "Debian packages are missing, you are not root and sudo was not found. Ask an administrator to run: $command"
        fi
        # Without a terminal sudo would wait for a password for ever.
        if ! sudo -n true 2>/dev/null && ! { [ -t 0 ] && sudo -v; }; then
            die "Debian packages are missing, and sudo is not permitted to install them. Ask an administrator to run: $command"
        fi
        become=(sudo)
    fi
    say "installing Debian packages (up to 3 GB, 1 to 2 minutes): ${missing[*]}"
    local apt=("${become[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=300)
    if [ -n "$(dpkg --audit 2>/dev/null)" ]; then # an earlier installation was interrupted
        "${become[@]}" env DEBIAN_FRONTEND=noninteractive dpkg --configure -a >&2 || true
    fi
    # Outdated package lists name files that the mirror no longer has. A failure here matters only if the next step fails.
    "${apt[@]}" update >&2 || true
    if ! "${apt[@]}" install -y --no-install-recommends "${missing[@]}" >&2; then
        die "apt could not install the Debian packages (its messages are above). Check the network; is this Debian 12" \
            "(python3-dolfinx-real is in its 'main')? Nothing else was changed. Try again after: $command"
    fi
}

# Hash of what an environment depends on: this script, the package part of pyproject.toml, the interpreter and the folder.
environment_key() {
    {
        cat "$root/demos/setup.sh"
        sed '/^# What follows configures tools only/,$d' "$root/pyproject.toml"
        readlink -f "$base_python"
        printf '%s\n' "$root"
    } | sha256sum
}

ensure_environment() {
    stamp=$venv/complete # written last; holds the environment key
    spare=$venv.old
    if ! is_complete; then
        [ -w "$root" ] || die "$root is not writable; clone the project into a folder of your own"
        build_environment
    fi
    python=$venv/bin/python
}

is_complete() {
    [ -f "$stamp" ] && [ -x "$venv/bin/python" ] && [ "$(<"$stamp")" = "$(environment_key)" ]
}

# Leaves either a complete environment or the previous one, also when interrupted.
build_environment() {
    local log
    child=''
    exec 9>"$venv.lock"
    if ! flock -n 9; then
        say "another setup is running in $root; waiting for it"
        flock 9
    fi
    # A killed setup leaves the previous environment in $spare.
    if [ -e "$spare" ]; then
        if [ -f "$stamp" ]; then rm -rf "$spare"; else rm -rf "$venv" && mv "$spare" "$venv"; fi
    fi
    if is_complete; then
        exec 9>&-
        return
    fi

    if ! python_says "$base_imports"; then
        die "$base_python cannot import the packages that the environment needs: $python_said"
    fi
    trap 'leave_no_half' EXIT
    trap 'exit 129' HUP
    trap 'exit 130' INT
    trap 'exit 143' TERM
    if [ -e "$venv" ] || [ -L "$venv" ]; then mv "$venv" "$spare"; fi
    say "creating the Python environment ${venv##*/} (1 GB from the network, about a minute)"
    "$base_python" -I -m venv "${venv_options[@]}" "$venv" || die "could not create $venv; is the disk full?"
    mkdir "$venv/tmp"
    log=$venv/tmp/pip.log
    # In a session of its own, so that it can be stopped with all its children.
    TMPDIR=$venv/tmp PIP_USER=0 PIP_REQUIRE_VIRTUALENV=0 PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONNOUSERSITE=1 \
        setsid env -u PYTHONPATH -u PYTHONHOME -u PIP_TARGET -u PIP_PREFIX \
        "$venv/bin/python" -m pip install --retries 2 --editable "${root}[test,dev]" >"$log" 2>&1 </dev/null &
    child=$!
    if ! wait "$child"; then
        child=''
        grep -E '^ *(ERROR|error):|No space left|Connection|Temporary failure' "$log" | tail -n 4 >&2 || true
        unavailable "pip could not install the Python packages (its messages are above). Check the network, the proxy or" \
            "index (PIP_INDEX_URL) and the disk space. The unfinished environment was removed"
    fi
    child=''
    python=$venv/bin/python
    if ! python_says "$works"; then
        if [[ $python_said == *'shared object file'* ]]; then
            unavailable "a system library is missing: $python_said. On Debian install: ${graphics_packages[*]}." \
                "The unfinished environment was removed"
        fi
        die "the new Python environment does not work and was removed: $python_said"
    fi
    rm -rf "$venv/tmp" # with its log, before the environment counts as complete
    environment_key >"$stamp.part"
    mv "$stamp.part" "$stamp"
    trap - EXIT HUP INT TERM
    rm -rf "$spare"
    exec 9>&-
}

# Runs Python code; on failure sets python_said to the last line of its output.
python_says() {
    local all
    all=$(env -u PYTHONPATH -u PYTHONHOME PYTHONNOUSERSITE=1 OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 \
        "${python:-$base_python}" -c "$1" 2>&1 </dev/null) && return
    python_said=$(tail -n 1 <<<"$all")
    return 1
}

leave_no_half() {
    local status=$?
    set +e # a child ended by a signal must not stop this clean-up
    trap '' HUP INT TERM
    if [ -n "$child" ]; then
        kill -TERM -- "-$child" 2>/dev/null
        wait "$child" 2>/dev/null
    fi
    [ -f "$stamp" ] && exit "$status"
    rm -rf "$venv"
    [ -e "$spare" ] && mv "$spare" "$venv"
    [ "$status" -lt 128 ] || say "interrupted; the unfinished environment was removed"
    exit "$status"
}
