# shellcheck shell=bash
# shellcheck disable=SC2154 # whoever sources it has set `root`
# Sourced by demos/run.sh and tests/run.sh, which set `root` to the project's folder.
#
# set_up   makes what is missing: Debian packages, and root/.venv, an environment that sees Debian's DOLFINx; or, with
#          RECEDING_ENV=pypi, root/.venv-pypi, an environment of PyPI's wheels alone.
# Then     $python is the environment's interpreter, $mpirun starts MPI programs.

# What PyPI's gmsh loads, and VTK for pictures without a display:
graphics_packages=(
    libosmesa6 libgl1 libglu1-mesa libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1
)
debian_packages=(
    python3-dolfinx-real python3-h5py python3-venv ca-certificates
    libopenblas0-pthread # without it MUMPS is 3 to 5 times slower
    "${graphics_packages[@]}"
)

# What must run before an environment counts as made: the imports, and compiling a form.
works='
from receding_fenicsx.bulk.elasticity import warm_up
import gmsh, h5py, matplotlib, pytest, scipy, vtk
from mpi4py import MPI
warm_up(MPI.COMM_SELF, "triangle", 1)'

say() { printf '%s: %s\n' "$(basename "$0")" "$*" >&2; }

die() {
    say "$@"
    exit 1
}

# For what this machine lacks, not what is wrong with the project.
unavailable() {
    say "$@"
    exit 69
}

set_up() {
    case ${RECEDING_ENV:-debian} in
        debian) set_up_debian ;;
        pypi) set_up_pypi ;;
        *) die "RECEDING_ENV=$RECEDING_ENV is not known; leave it out, or say debian or pypi" ;;
    esac
    # A foreign PYTHONPATH or packages in the user's home would come before what was set up here.
    unset PYTHONPATH PYTHONHOME
    export PYTHONNOUSERSITE=1
    # One BLAS thread a rank: on small dense systems more of them are up to 70 times slower.
    export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
    # Open MPI: allow root, allow more ranks than cores, pin no rank to a core, let a waiting rank give its core to others,
    # and do not read the memory of another process directly, which containers forbid.
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    export OMPI_MCA_rmaps_base_oversubscribe=1 OMPI_MCA_hwloc_base_binding_policy=none
    export OMPI_MCA_mpi_yield_when_idle=1
    export OMPI_MCA_btl_vader_single_copy_mechanism=none
}

set_up_debian() {
    venv=$root/.venv
    base_python=/usr/bin/python3 # Debian's DOLFINx serves this one only, whatever python3 comes first on PATH
    venv_options=(--system-site-packages)
    base_imports='import venv, ensurepip, mpi4py.MPI, petsc4py.PETSc, dolfinx'
    install_debian_packages
    ensure_environment
    mpirun=/usr/bin/mpirun.openmpi # what Debian's DOLFINx is linked with; `mpirun` may be another MPI's
    [ -x "$mpirun" ] || mpirun=/usr/bin/mpirun
}

set_up_pypi() {
    venv=$root/.venv-pypi
    base_python=$(find_new_python) || unavailable "PyPI's DOLFINx needs Python >= 3.12 with venv and ensurepip, and there is none on" \
        "PATH or among pyenv's versions. Install one: 'pyenv install 3.13', or Debian 13's python3-venv and python3-dev"
    venv_options=()
    base_imports='import venv, ensurepip'
    command -v "${CC:-cc}" >/dev/null ||
        unavailable "there is no C compiler (${CC:-cc}), with which DOLFINx compiles its forms. Install gcc, or name yours in CC"
    ensure_environment
    mpirun=$venv/bin/mpiexec # PyPI's MPI cannot be started by another one
}

# Prints the oldest Python >= 3.12 that can make environments, or nothing: for the newest there may be no wheels yet.
find_new_python() {
    local candidate
    for candidate in python3 python3.{12..19} "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3.*/bin/python; do
        # a name without a slash may be a shim of pyenv for a version that is not chosen: only running it tells
        "$candidate" -I -c 'if True:
            import sys, venv, ensurepip
            if sys.version_info >= (3, 12) and sys.version_info.releaselevel == "final":
                print(*sys.version_info[:3], sys.executable)' 2>/dev/null </dev/null || true
    done | sort -k1,1n -k2,2n -k3,3n | head -n 1 | cut -d ' ' -f 4- | grep .
}

# Prints those of the Debian packages that are not installed.
missing_packages() {
    comm -23 <(printf '%s\n' "${debian_packages[@]}" | sort) <(
        dpkg-query -W -f '${db:Status-Status} ${Package}\n' "${debian_packages[@]}" 2>/dev/null |
            sed -n 's/^installed //p' | sort
    )
}

install_debian_packages() {
    local missing become=() command
    if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
        die "apt is not here: this sets up Debian 12 and its like only. Elsewhere set RECEDING_ENV=pypi, which needs" \
            "Python >= 3.12, or make DOLFINx work in a Python environment of your own and run 'pip install .' in it"
    fi
    mapfile -t missing < <(missing_packages)
    [ ${#missing[@]} -gt 0 ] || return 0
    command="apt-get install --no-install-recommends ${missing[*]}"
    if [ "$(id -u)" -ne 0 ]; then
        if ! command -v sudo >/dev/null; then
            die "Debian packages are missing, and you are neither root nor have sudo. Ask an administrator to run: $command"
        fi
        # Without a terminal sudo could only wait for a password that nobody can type.
        if ! sudo -n true 2>/dev/null && ! { [ -t 0 ] && sudo -v; }; then
            die "Debian packages are missing, and sudo does not let you install them. Ask an administrator to run: $command"
        fi
        become=(sudo)
    fi
    say "installing Debian packages (3 GB on a bare system, 1 to 2 minutes): ${missing[*]}"
    local apt=("${become[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=300)
    if [ -n "$(dpkg --audit 2>/dev/null)" ]; then # an earlier installation was interrupted
        "${become[@]}" env DEBIAN_FRONTEND=noninteractive dpkg --configure -a >&2 || true
    fi
    # Old lists name files that the mirror no longer has. A failure here is shown, and matters only if the next step fails.
    "${apt[@]}" update >&2 || true
    if ! "${apt[@]}" install -y --no-install-recommends "${missing[@]}" >&2; then
        die "apt could not install the Debian packages (its own words are above): is the network there, and is this Debian 12" \
            "(python3-dolfinx-real is in its 'main')? Nothing else was changed; to be repeated after: $command"
    fi
}

# The environment depends on this script, on what pyproject.toml says of the package, on the interpreter, and on its folder.
environment_key() {
    {
        cat "$root/demos/setup.sh"
        sed '/^# What follows configures tools only/,$d' "$root/pyproject.toml"
        readlink -f "$base_python"
        printf '%s\n' "$root"
    } | sha256sum
}

ensure_environment() {
    stamp=$venv/complete # written last; holds the key of what the environment was made from
    spare=$venv.old
    if ! is_complete; then
        [ -w "$root" ] || die "no right to write in $root; clone the project into a folder of your own"
        build_environment
    fi
    python=$venv/bin/python
}

is_complete() {
    [ -f "$stamp" ] && [ -x "$venv/bin/python" ] && [ "$(<"$stamp")" = "$(environment_key)" ]
}

# However it ends, it leaves either a complete environment or the one from before.
build_environment() {
    local log
    child=''
    exec 9>"$venv.lock"
    if ! flock -n 9; then
        say "another setup is under way in $root; waiting for it"
        flock 9
    fi
    # What a killed setup left: the environment from before stands aside.
    if [ -e "$spare" ]; then
        if [ -f "$stamp" ]; then rm -rf "$spare"; else rm -rf "$venv" && mv "$spare" "$venv"; fi
    fi
    if is_complete; then
        exec 9>&-
        return
    fi

    if ! python_says "$base_imports"; then
        die "what the environment is made from is installed, but $base_python cannot import it: $python_said"
    fi
    trap 'leave_no_half' EXIT
    trap 'exit 129' HUP
    trap 'exit 130' INT
    trap 'exit 143' TERM
    if [ -e "$venv" ] || [ -L "$venv" ]; then mv "$venv" "$spare"; fi
    say "making the Python environment ${venv##*/} (1 GB from the network, about half a minute)"
    "$base_python" -I -m venv "${venv_options[@]}" "$venv" || die "could not make $venv: is the disk full?"
    mkdir "$venv/tmp"
    log=$venv/tmp/pip.log
    # In a session of its own, so that it can be ended with all its children.
    TMPDIR=$venv/tmp PIP_USER=0 PIP_REQUIRE_VIRTUALENV=0 PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONNOUSERSITE=1 \
        setsid env -u PYTHONPATH -u PYTHONHOME -u PIP_TARGET -u PIP_PREFIX \
        "$venv/bin/python" -m pip install --retries 2 --editable "${root}[test,dev]" >"$log" 2>&1 </dev/null &
    child=$!
    if ! wait "$child"; then
        child=''
        grep -E '^ *(ERROR|error):|No space left|Connection|Temporary failure' "$log" | tail -n 4 >&2 || true
        unavailable "pip could not install the Python packages (its own words are above): is the network there," \
            "is a proxy or an index to be set (PIP_INDEX_URL), is the disk full? Nothing half-made was left"
    fi
    child=''
    python=$venv/bin/python
    if ! python_says "$works"; then
        if [[ $python_said == *'shared object file'* ]]; then
            unavailable "a library of the system is missing: $python_said. On Debian the packages with all of them are:" \
                "${graphics_packages[*]}. The environment was taken away again"
        fi
        die "the Python environment was made, but does not work: $python_said. It was taken away again"
    fi
    rm -rf "$venv/tmp" # while it holds the log, nothing is complete
    environment_key >"$stamp.part"
    mv "$stamp.part" "$stamp"
    trap - EXIT HUP INT TERM
    rm -rf "$spare"
    exec 9>&-
}

# Runs a line of Python; on failure leaves the last line of what it said in python_said.
python_says() {
    local all
    all=$(env -u PYTHONPATH -u PYTHONHOME PYTHONNOUSERSITE=1 OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 \
        "${python:-$base_python}" -c "$1" 2>&1 </dev/null) && return
    python_said=$(tail -n 1 <<<"$all")
    return 1
}

leave_no_half() {
    local status=$?
    set +e # the child's own end by a signal must not end the clearing up
    trap '' HUP INT TERM
    if [ -n "$child" ]; then
        kill -TERM -- "-$child" 2>/dev/null
        wait "$child" 2>/dev/null
    fi
    [ -f "$stamp" ] && exit "$status"
    rm -rf "$venv"
    [ -e "$spare" ] && mv "$spare" "$venv"
    [ "$status" -lt 128 ] || say "interrupted; nothing half-made was left"
    exit "$status"
}
