"""Arguments of the command line, ``receding-fenicsx``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from receding_fenicsx import __version__
from receding_fenicsx.errors import InputError

PROGRAM = "receding-fenicsx"


class _Parser(argparse.ArgumentParser):
    """Parser that raises InputError, and prints help on rank 0 only."""

    root = True

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see {self.prog} --help")

    def _print_message(self, message: str, file: Any = None) -> None:
        if self.root and message:
            print(message, end="", file=file or sys.stderr)


def make_parser(root: bool) -> argparse.ArgumentParser:
    """Return the parser of all commands.

    Args:
        root: whether this process prints help and version.
    """
    parser = type("Parser", (_Parser,), {"root": root})(
        prog=PROGRAM,
        description="Frictional receding contact under cyclic loading.",
        allow_abbrev=False,
    )
    parser.set_defaults(verbose=0)
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for name, (arguments, text) in COMMANDS.items():
        added = commands.add_parser(name, help=text, description=text, allow_abbrev=False)
        arguments(added)
    return parser


def _run(added: argparse.ArgumentParser) -> None:
    _scene(added)
    _out(added, "output folder", "an earlier run")
    _resume(added, "continue an interrupted run, or extend a finished run by more cycles")
    added.add_argument(
        "--system",
        metavar="FILE",
        help="reuse a saved system (from condense, or a run's system.h5) without condensing again",
    )
    added.add_argument(
        "--pictures",
        choices=("all", "figures", "none"),
        help="all: every figure, and snapshots of the body at the turning points of the first and "
        "the last cycles; figures: every figure, no snapshots, which need the body's mesh. "
        "Default: the few that answer the scene's question, without the body with --system",
    )
    added.add_argument("--pdf", action="store_true", help="draw the figures as PDF too")
    added.add_argument(
        "--error",
        action="store_true",
        help="solve on three coarser meshes too and estimate the discretisation error in space",
    )
    added.add_argument(
        "--starts",
        type=int,
        default=0,
        metavar="N",
        help='find the limit (until = "limit") from N initial slips too: rest, four extreme ones, '
        "then random ones; report how far they differ",
    )
    added.add_argument(
        "--tolerance",
        type=float,
        metavar="E",
        help="choose the mesh so that the relative errors of the numbers are below E (the table "
        "[accuracy] names the numbers and the budget)",
    )
    _verbose(added)


def _condense(added: argparse.ArgumentParser) -> None:
    _scene(added)
    _out_file(added, "system")
    _verbose(added)


def _sweep(added: argparse.ArgumentParser) -> None:
    _scene(added)
    added.add_argument(
        "--over",
        action="append",
        required=True,
        metavar="TABLE.KEY=VALUES",
        help="values of one key, as for --set: a list 0,0.25,0.5 or a range first:last:number, as "
        "in contact.friction=0.1:0.9:9; may be repeated: all combinations are run",
    )
    _cases(
        added,
        "folder for sweep.csv (a row for each case), sweep.json (scene, keys, versions) and "
        "cases.jsonl (finished cases, to resume from)",
        "sweep",
    )
    _verbose(added)


def _cases(added: argparse.ArgumentParser, out: str, what: str) -> None:
    _out(added, out, f"an earlier {what}")
    _resume(added, f"continue an interrupted {what}; values may have been added")
    added.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="run the cases on N new processes of this machine (default: on this one). On several "
        "machines start the command under mpirun instead: rank 0 hands out the cases",
    )


def _shakedown(added: argparse.ArgumentParser) -> None:
    _scene(added)
    _out(added, "output folder", "an earlier study")
    _verbose(added)


def _joint(added: argparse.ArgumentParser) -> None:
    _scene(added)
    added.add_argument(
        "--drive", required=True, metavar="LOAD", help="driven load, or mode:1, mode:2"
    )
    for name, text in (("from", "smallest"), ("to", "largest")):
        added.add_argument(
            f"--{name}",
            dest=text,
            type=float,
            required=True,
            metavar="A",
            help=f"{text} amplitude, as a load factor",
        )
    added.add_argument(
        "--count", type=int, default=30, metavar="N", help="number of amplitudes, log spaced (30)"
    )
    out = "folder for joint.csv (a row for each amplitude), joint.json and joint.png"
    _cases(added, out, "curve")
    _verbose(added)


def _snapshot(added: argparse.ArgumentParser) -> None:
    _run_folder(added)
    _cycle(added, required=True)
    _leg(added, required=True)
    added.add_argument(
        "--at", type=float, default=1.0, metavar="S", help="position along the leg, 0 to 1 (1)"
    )
    _verbose(added)


def _animate(added: argparse.ArgumentParser) -> None:
    _run_folder(added)
    _cycle(added, required=True)
    added.add_argument("--frames", type=int, default=60, metavar="N", help="number of frames (60)")
    added.add_argument(
        "--stress",
        default="max_shear",
        metavar="NAME",
        help="max_shear (drawn as fringes), von_mises, sxx, syy or sxy",
    )


def _import(added: argparse.ArgumentParser) -> None:
    added.add_argument("specification", metavar="IMPORT.toml", help="names of matrices and nodes")
    _out_file(added, "system")


def _export(added: argparse.ArgumentParser) -> None:
    added.add_argument(
        "source",
        metavar="DIR|SYSTEM|SCENE",
        help="run folder, file of a saved system, or with --reduced a scene",
    )
    _out_file(added, "load step")
    added.add_argument(
        "--matrices",
        action="store_true",
        help="write K, r* and the nodes of the system as MatrixMarket and CSV into the folder FILE",
    )
    added.add_argument(
        "--reduced",
        action="store_true",
        help="write mass, stiffness and contact of the joint, reduced to its contact nodes and "
        "[mode] count modes (Craig and Bampton), as HDF5",
    )
    _cycle(added, required=False)
    _leg(added, required=False)
    added.add_argument(
        "--at", type=float, default=1.0, metavar="S", help="end of the load step, 0 to 1 (1)"
    )
    added.add_argument(
        "--since",
        type=float,
        metavar="S",
        help="start of the load step; default: 1 / solver.steps_per_leg before its end",
    )


def _scene(added: argparse.ArgumentParser) -> None:
    added.add_argument("scene", metavar="SCENE.toml", help="scene file")
    added.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        dest="overrides",
        help="change a value of the scene (load.NAME.key=value for loads); may be repeated",
    )


def _out(added: argparse.ArgumentParser, text: str, earlier: str, metavar: str = "DIR") -> None:
    added.add_argument("--out", required=True, metavar=metavar, help=text)
    added.add_argument("--overwrite", action="store_true", help=f"replace {earlier}")


def _out_file(added: argparse.ArgumentParser, what: str) -> None:
    _out(added, f"HDF5 file of the {what}", "the file", "FILE")


def _resume(added: argparse.ArgumentParser, text: str) -> None:
    added.add_argument("--resume", action="store_true", help=text)


def _run_folder(added: argparse.ArgumentParser) -> None:
    added.add_argument("folder", metavar="DIR", help="run folder")


def _cycle(added: argparse.ArgumentParser, required: bool) -> None:
    added.add_argument(
        "--cycle",
        type=int,
        required=required,
        default=0,
        metavar="N",
        help="cycle number; 0 is the first loading",
    )


def _leg(added: argparse.ArgumentParser, required: bool) -> None:
    added.add_argument(
        "--leg",
        required=required,
        default="0",
        metavar="loading|unloading|K",
        help="leg of the cycle, by name or by number from 0",
    )


def _verbose(added: argparse.ArgumentParser) -> None:
    added.add_argument(
        "-v",
        "--verbose",
        action="count",
        default=0,
        help="log stages, cycles, residuals and timings; twice: every change of state too",
    )


COMMANDS: dict[str, tuple[Callable[[argparse.ArgumentParser], None], str]] = {
    "run": (_run, "run a study: mesh, condense, evolve, write results, draw pictures"),
    "condense": (_condense, "condense the body to its contact nodes and save the system"),
    "sweep": (_sweep, "run a scene for every combination of values; write a table"),
    "shakedown": (_shakedown, "find the load range up to which the contact stops slipping"),
    "joint": (_joint, "find dissipation and stiffness over the amplitude of a driven load"),
    "plot": (_run_folder, "draw the figures of a finished run again, as PNG and PDF"),
    "snapshot": (_snapshot, "draw the body of a finished run at one instant"),
    "animate": (_animate, "make an animation of one cycle of a finished run"),
    "export": (
        _export,
        "export a load step in FCLIB's format, or the matrices, for other programs",
    ),
    "import": (_import, "make a system of matrices of Abaqus, CalculiX or others (MatrixMarket)"),
    "check": (_scene, "validate a scene without running it"),
    "doctor": (lambda _: None, "list installed versions and test the installation"),
}
"""Arguments and help text of each command."""
