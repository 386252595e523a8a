# shellcheck shell=bash
# Sourced by demos/run.sh and tests/run.sh, which set `root` to the project's folder.
#
# set_up   makes what is missing: Debian packages, and root/.venv, an environment that sees Debian's DOLFINx.
# Then     $python is the environment's interpreter, $mpirun starts MPI programs.

debian_packages=(
    python3-dolfinx-real python3-h5py python3-venv ca-certificates
    libopenblas0-pthread # without it MUMPS is 3 to 5 times slower
    # What PyPI's gmsh loads, and VTK for pictures without a display:
    libosmesa6 libgl1 libglu1-mesa libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1
)
system_python=/usr/bin/python3 # Debian's DOLFINx serves this one only, whatever python3 comes first on PATH
venv=$root/.venv
stamp=$venv/complete # written last; holds the key of what the environment was made from
spare=$root/.venv.old

say() { printf '%s: %s\n' "$(basename "$0")" "$*" >&2; }

die() {
    say "$@"
    exit 1
}

set_up() {
    case ${RECEDING_ENV:-debian} in
        debian) set_up_debian ;;
        *) die "RECEDING_ENV=$RECEDING_ENV is not known; leave it out, or say debian" ;;
    esac
    # A foreign PYTHONPATH or packages in the user's home would come before what was set up here.
    unset PYTHONPATH PYTHONHOME
    export PYTHONNOUSERSITE=1
    # One BLAS thread a rank: on small dense systems more of them are up to 70 times slower.
    export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
    # Open MPI: allow root, allow more ranks than cores, pin no rank to a core, and do not read the memory of another
    # process directly, which containers forbid.
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    export OMPI_MCA_rmaps_base_oversubscribe=1 OMPI_MCA_hwloc_base_binding_policy=none
    export OMPI_MCA_btl_vader_single_copy_mechanism=none
}

set_up_debian() {
    install_debian_packages
    if ! is_complete; then
        [ -w "$root" ] || die "no right to write in $root; clone the project into a folder of your own"
        build_environment
    fi
    python=$venv/bin/python
    mpirun=/usr/bin/mpirun.openmpi # what Debian's DOLFINx is linked with; `mpirun` may be another MPI's
    [ -x "$mpirun" ] || mpirun=/usr/bin/mpirun
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
        die "apt is not here: this sets up Debian 12 and its like only." \
            "Elsewhere make DOLFINx work in a Python environment of your own and run 'pip install .' in it"
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
        readlink -f "$system_python"
        printf '%s\n' "$root"
    } | sha256sum
}

is_complete() {
    [ -f "$stamp" ] && [ -x "$venv/bin/python" ] && [ "$(<"$stamp")" = "$(environment_key)" ]
}

# However it ends, it leaves either a complete environment or the one from before.
build_environment() {
    local log
    child=''
    exec 9>"$root/.venv.lock"
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

    if ! python_says 'import venv, ensurepip, mpi4py.MPI, petsc4py.PETSc, dolfinx'; then
        die "Debian's packages are installed, but $system_python cannot import them: $python_said"
    fi
    trap 'leave_no_half' EXIT
    trap 'exit 129' HUP
    trap 'exit 130' INT
    trap 'exit 143' TERM
    if [ -e "$venv" ] || [ -L "$venv" ]; then mv "$venv" "$spare"; fi
    say "making the Python environment .venv (1 GB from the network, about half a minute)"
    "$system_python" -I -m venv --system-site-packages "$venv" || die "could not make $venv: is the disk full?"
    mkdir "$venv/tmp"
    log=$venv/tmp/pip.log
    # In a session of its own, so that it can be ended with all its children.
    TMPDIR=$venv/tmp PIP_USER=0 PIP_REQUIRE_VIRTUALENV=0 PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONNOUSERSITE=1 \
        setsid env -u PYTHONPATH -u PYTHONHOME -u PIP_TARGET -u PIP_PREFIX \
        "$venv/bin/python" -m pip install --retries 2 --editable "$root[test,dev]" >"$log" 2>&1 </dev/null &
    child=$!
    if ! wait "$child"; then
        child=''
        grep -E '^ *(ERROR|error):|No space left|Connection|Temporary failure' "$log" | tail -n 4 >&2 || true
        die "pip could not install the Python packages (its own words are above): is the network there," \
            "is a proxy or an index to be set (PIP_INDEX_URL), is the disk full? Nothing half-made was left"
    fi
    child=''
    python=$venv/bin/python
    if ! python_says 'import dolfinx, h5py, scipy, gmsh, matplotlib, vtk, pytest, receding_fenicsx'; then
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
        "${python:-$system_python}" -c "$1" 2>&1 </dev/null) && return
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
