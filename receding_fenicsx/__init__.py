"""Frictional receding contact of elastic bodies under cyclic loading, with FEniCSx.

One import is enough; every name below is loaded when it is first used::

    import receding_fenicsx as rf

From a scene to its results in one call::

    scene = rf.read_scene("block.toml", ["history.cycles=20"])  # a TOML file, with changes
    record = rf.run(scene)                                      # in memory
    record = rf.run(scene, "results/mine")                      # also files, figures, report

or in steps, to apply other histories, frictions and gaps to the same condensed body::

    system = rf.condense(scene, whole=True)           # K and r_star on the contact nodes, eq. (11)
    record = rf.evolve(system, scene)                 # or another scene of the same body

A :class:`Record` returns values by name, tables and figures::

    low = record.at(cycle=9, load="minimum")          # low.x, low.p, low.q, low.v, low.w, low.zones
    record.cycles.dissipation                         # one value for each cycle, from cycle 1
    record.to_pandas()                                # or to_xarray(), to_table()
    rf.figures.tractions(record, low)                 # a Matplotlib figure; or zone_maps, ...

One scene over a grid of values, a row of a table for each case::

    table = rf.sweep(scene, {"contact.friction": [0.2, 0.4], "history.minimum": [0.0, 0.5]})
    table["dissipation_last_cycle"], table.grid("steady"), table.to_pandas()

Signs and symbols are those of Ahn & Barber (2008): ``v, w`` tangential and normal displacement,
``Q, P`` tangential and normal reaction on the body, ``P > 0`` compression; "load" is a load factor.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

# The interface's dense matrices are small: with the default number of threads their products and
# solves were measured up to 70 times slower than with one. The libraries read this once, when NumPy
# loads them; what the user has set wins.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

if TYPE_CHECKING:
    from receding_fenicsx import reference as reference
    from receding_fenicsx.accuracy.estimate import Estimate as Estimate
    from receding_fenicsx.accuracy.estimate import Level as Level
    from receding_fenicsx.accuracy.estimate import estimates_of as estimates_of
    from receding_fenicsx.accuracy.meshes import graded_at_ends as graded_at_ends
    from receding_fenicsx.accuracy.meshes import scaled as scaled_mesh
    from receding_fenicsx.accuracy.numbers import Number as Number
    from receding_fenicsx.accuracy.numbers import headline as headline
    from receding_fenicsx.accuracy.space_errors import level_of as level_of
    from receding_fenicsx.accuracy.space_errors import space_errors as space_errors
    from receding_fenicsx.accuracy.zone_end_mesh import (
        refined_at_zone_ends as refined_at_zone_ends,
    )
    from receding_fenicsx.environment import child_environment as child_environment
    from receding_fenicsx.errors import InputError as InputError
    from receding_fenicsx.errors import Interrupted as Interrupted
    from receding_fenicsx.errors import NoEquilibrium as NoEquilibrium
    from receding_fenicsx.errors import NoQuasiStaticContinuation as NoQuasiStaticContinuation
    from receding_fenicsx.errors import NotConverged as NotConverged
    from receding_fenicsx.errors import RecedingError as RecedingError
    from receding_fenicsx.errors import SolveError as SolveError
    from receding_fenicsx.errors import ToleranceNotMet as ToleranceNotMet
    from receding_fenicsx.evolution.branching.tree import Branch as Branch
    from receding_fenicsx.evolution.branching.tree import BranchTree as BranchTree
    from receding_fenicsx.evolution.branching.tree import branches as branches
    from receding_fenicsx.evolution.evolve import evolve as evolve
    from receding_fenicsx.evolution.limit.starts import SteadyStates as SteadyStates
    from receding_fenicsx.evolution.limit.starts import steady_states as steady_states
    from receding_fenicsx.evolution.moment import recovered_tractions as recovered_tractions
    from receding_fenicsx.evolution.probe_history import ProbeHistory as ProbeHistory
    from receding_fenicsx.evolution.record import Record as Record
    from receding_fenicsx.evolution.replay import instant_of as instant_of
    from receding_fenicsx.evolution.replay import state_at as state_at
    from receding_fenicsx.evolution.solvers import SOLVERS as SOLVERS
    from receding_fenicsx.exchange.importing import import_system as import_system
    from receding_fenicsx.exchange.reduced import ReducedModel as ReducedModel
    from receding_fenicsx.exchange.reduced import reduced_model as reduced_model
    from receding_fenicsx.interface.branches.critical_friction import (
        CriticalFriction as CriticalFriction,
    )
    from receding_fenicsx.interface.branches.critical_friction import (
        critical_friction as critical_friction,
    )
    from receding_fenicsx.interface.law import STATE_NAMES as STATE_NAMES
    from receding_fenicsx.interface.law import State as State
    from receding_fenicsx.interface.measures.tractions import traction_at as traction_at
    from receding_fenicsx.interface.measures.zone_ends import dundurs_beta as dundurs_beta
    from receding_fenicsx.interface.measures.zones import contact_half_width as contact_half_width
    from receding_fenicsx.interface.measures.zones import stick_half_width as stick_half_width
    from receding_fenicsx.interface.measures.zones import zones as zones
    from receding_fenicsx.interface.shakedown.limits import ShakedownLimits as ShakedownLimits
    from receding_fenicsx.interface.shakedown.limits import shakedown_limits as shakedown_limits
    from receding_fenicsx.interface.solver import Solver as Solver
    from receding_fenicsx.interface.system import ContactState as ContactState
    from receding_fenicsx.interface.system import ContactSystem as ContactSystem
    from receding_fenicsx.interface.system import Leg as Leg
    from receding_fenicsx.interface.system import reactions as reactions
    from receding_fenicsx.joints.curve import joint_curve as joint_curve
    from receding_fenicsx.joints.figure import joint_figure as joint_figure
    from receding_fenicsx.joints.fits import JointFit as JointFit
    from receding_fenicsx.joints.fits import fit_iwan as fit_iwan
    from receding_fenicsx.joints.fits import fit_jenkins as fit_jenkins
    from receding_fenicsx.joints.result import JointCurve as JointCurve
    from receding_fenicsx.measures.half_widths import estimates as half_width_estimates
    from receding_fenicsx.measures.half_widths import half_widths as half_widths
    from receding_fenicsx.mpi import given as given
    from receding_fenicsx.mpi import on_all as on_all
    from receding_fenicsx.mpi import on_root as on_root
    from receding_fenicsx.output.plots import figures as figures
    from receding_fenicsx.output.plots import style as style
    from receding_fenicsx.output.plots.loops import loop_of as loop_of
    from receding_fenicsx.output.report.html import write_report as write_report
    from receding_fenicsx.output.report.summary import summarise as summarise
    from receding_fenicsx.output.report.text import run_table as run_table
    from receding_fenicsx.output.storage.fclib import export as export
    from receding_fenicsx.output.storage.hdf5 import read_record as read_record
    from receding_fenicsx.output.storage.hdf5 import read_system as read_system
    from receding_fenicsx.output.storage.hdf5 import write_record as write_record
    from receding_fenicsx.output.storage.hdf5 import write_system as write_system
    from receding_fenicsx.output.storage.summary_file import read_summary as read_summary
    from receding_fenicsx.parameter_sweep.sweep import SweepOptions as SweepOptions
    from receding_fenicsx.parameter_sweep.sweep import sweep as sweep
    from receding_fenicsx.parameter_sweep.table import SweepTable as SweepTable
    from receding_fenicsx.pictures import animate as animate
    from receding_fenicsx.pictures import draw_slip_mode as draw_slip_mode
    from receding_fenicsx.pictures import plot as plot
    from receding_fenicsx.pictures import snapshot as snapshot
    from receding_fenicsx.scene.history import History as History
    from receding_fenicsx.scene.history import from_scene as history_from_scene
    from receding_fenicsx.scene.model import AccuracyOptions as AccuracyOptions
    from receding_fenicsx.scene.model import Body as Body
    from receding_fenicsx.scene.model import Bolt as Bolt
    from receding_fenicsx.scene.model import Contact as Contact
    from receding_fenicsx.scene.model import Harmonic as Harmonic
    from receding_fenicsx.scene.model import HistoryOptions as HistoryOptions
    from receding_fenicsx.scene.model import Load as Load
    from receding_fenicsx.scene.model import Material as Material
    from receding_fenicsx.scene.model import MeshOptions as MeshOptions
    from receding_fenicsx.scene.model import ModeOptions as ModeOptions
    from receding_fenicsx.scene.model import OutputOptions as OutputOptions
    from receding_fenicsx.scene.model import Probe as Probe
    from receding_fenicsx.scene.model import Refinement as Refinement
    from receding_fenicsx.scene.model import Scene as Scene
    from receding_fenicsx.scene.model import ShakedownOptions as ShakedownOptions
    from receding_fenicsx.scene.model import SolverOptions as SolverOptions
    from receding_fenicsx.scene.model import Spring as Spring
    from receding_fenicsx.scene.model import Support as Support
    from receding_fenicsx.scene.options import NUMBERS as HEADLINE_NAMES
    from receding_fenicsx.scene.toml_file import from_toml as from_toml
    from receding_fenicsx.scene.toml_file import read_scene as read_scene
    from receding_fenicsx.scene.toml_file import to_toml as to_toml
    from receding_fenicsx.scene.units import Units as Units
    from receding_fenicsx.scene.validate import validate as validate
    from receding_fenicsx.scene.validate import warnings as scene_warnings
    from receding_fenicsx.shakedown_study.cycles import range_history as range_history
    from receding_fenicsx.shakedown_study.figures import (
        steady_states_figure as steady_states_figure,
    )
    from receding_fenicsx.shakedown_study.opening import opening_limit as opening_limit
    from receding_fenicsx.shakedown_study.result import ShakedownStudy as ShakedownStudy
    from receding_fenicsx.shakedown_study.study import shakedown as shakedown
    from receding_fenicsx.study import RunOptions as RunOptions
    from receding_fenicsx.study import condense as condense
    from receding_fenicsx.study import run as run

__version__ = "0.1.0"

# name: (module, or module:name where it has another name there, or module: for the module itself;
# one line of description)
_PUBLIC: dict[str, dict[str, tuple[str, str]]] = {
    "Scene": {
        "Scene": ("scene.model", "What is modelled: body, material, mesh, contacts, loads, ..."),
        "Body": ("scene.model", "Shape of a body: rectangle, or mesh file"),
        "Material": ("scene.model", "Elastic constants, and plane or axisymmetric kinematics"),
        "MeshOptions": ("scene.model", "Number, shape, order and grading of the elements"),
        "Refinement": ("scene.model", "Place on a contact edge with smaller elements"),
        "Contact": ("scene.model", "Contact edge, its friction and its initial gap"),
        "Load": ("scene.model", "What acts on an edge or a body, times a load factor"),
        "Bolt": ("scene.model", "Bolt between two patches"),
        "Spring": ("scene.model", "Springs of an edge or a point"),
        "Support": ("scene.model", "Edge or point that is fixed"),
        "Probe": ("scene.model", "Points at which displacement and stress are recorded"),
        "Units": ("scene.units", "Names of the units that a scene's numbers are in, for labels"),
        "HistoryOptions": ("scene.model", "History of the load factors, as a scene gives it"),
        "Harmonic": ("scene.model", "Mean, amplitude and phase of a load of a harmonic history"),
        "SolverOptions": ("scene.model", "Method, load steps, tolerances, symmetry"),
        "AccuracyOptions": ("scene.model", "Tolerance, numbers and budget of a search for a mesh"),
        "ModeOptions": ("scene.model", "Number of vibration modes that are computed"),
        "OutputOptions": ("scene.model", "Cycles and samples that the record keeps"),
        "read_scene": ("scene.toml_file", "Read a scene file, with changes table.key=value"),
        "from_toml": ("scene.toml_file", "Read a scene from TOML text"),
        "to_toml": ("scene.toml_file", "Write a scene as TOML text"),
        "validate": ("scene.validate", "Check a scene; raise InputError with the reason"),
        "scene_warnings": ("scene.validate:warnings", "Warnings about a scene that can be run"),
        "History": ("scene.history", "Polyline of load factors and the cycle that follows it"),
        "history_from_scene": ("scene.history:from_scene", "Return the History of a scene"),
    },
    "Contact system": {
        "condense": ("study", "Mesh, assemble and condense a scene to its contact nodes"),
        "ContactSystem": ("interface.system", "Condensed K and r_star, friction and gap, eq. 11"),
        "ContactState": ("interface.system", "Displacements, reactions and states of all nodes"),
        "State": ("interface.law", "STICK, SEPARATION, FORWARD_SLIP, BACKWARD_SLIP: 1 to 4"),
        "STATE_NAMES": ("interface.law", "Names of the states in words"),
        "reactions": ("interface.system", "Reactions at given loads and displacements, eq. 11"),
        "read_system": ("output.storage.hdf5", "Read a ContactSystem from an HDF5 file"),
        "import_system": ("exchange.importing", "Make a ContactSystem of matrices from files"),
        "reduced_model": (
            "exchange.reduced",
            "Reduce a scene with masses to its contact",
        ),
        "ReducedModel": ("exchange.reduced", "M, K and contact of a joint, for dynamics codes"),
        "write_system": ("output.storage.hdf5", "Write a ContactSystem to an HDF5 file"),
    },
    "Run": {
        "run": ("study", "Run a scene: mesh, condense, evolve, write files and pictures"),
        "RunOptions": ("study", "What a run writes and draws, and what it starts from"),
        "evolve": ("evolution.evolve", "Follow a history on a condensed system"),
        "Solver": ("interface.solver", "Protocol of a solver: follows one leg after another"),
        "SOLVERS": ("evolution.solvers", "Solvers by their names in [solver] method"),
        "Leg": ("interface.system", "What a solver returns for a leg"),
        "Record": ("evolution.record", "Results: turning points, samples, events, cycles"),
        "ProbeHistory": ("evolution.probe_history", "Stress and displacement at a probe's points"),
        "read_record": ("output.storage.hdf5", "Read a Record from an HDF5 file"),
        "write_record": ("output.storage.hdf5", "Write a Record to an HDF5 file"),
        "instant_of": ("evolution.replay", "Replay the state at an instant named by cycle and leg"),
        "state_at": ("evolution.replay", "Replay the state at cycle, leg number and position s"),
    },
    "Several continuations": {
        "branches": ("evolution.branching.tree", "Follow all branches of a history"),
        "BranchTree": ("evolution.branching.tree", "Branches of a history, each with its record"),
        "critical_friction": ("interface.branches.critical_friction", "Friction of a slip mode"),
        "CriticalFriction": ("interface.branches.critical_friction", "Its bounds, and the mode"),
        "Branch": ("evolution.branching.tree", "One path through all choices"),
    },
    "Sweep": {
        "sweep": ("parameter_sweep.sweep", "Run a scene for every combination of values"),
        "SweepOptions": ("parameter_sweep.sweep", "Options of a sweep: resume, overwrite, ..."),
        "SweepTable": ("parameter_sweep.table", "Result of a sweep: a row for each case"),
    },
    "Joints": {
        "joint_curve": ("joints.curve", "Dissipation and stiffness over the amplitude"),
        "JointCurve": ("joints.result", "These, with Masing's rule and the first loading"),
        "fit_iwan": ("joints.fits", "Fit Iwan's model of four parameters to a curve"),
        "fit_jenkins": ("joints.fits", "Fit Jenkins elements in parallel to a curve"),
        "JointFit": ("joints.fits", "Parameters and errors of a fit"),
        "joint_figure": ("joints.figure", "Figure of a curve"),
    },
    "Evaluation": {
        "zones": ("interface.measures.zones", "Zones of equal state along the contact edge"),
        "contact_half_width": ("interface.measures.zones", "Contact half width, to node spacing"),
        "stick_half_width": ("interface.measures.zones", "Stick half width, to node spacing"),
        "half_widths": ("measures.half_widths", "Both half widths at a turning point"),
        "half_width_estimates": ("measures.half_widths:estimates", "Fitted, with intervals"),
        "dundurs_beta": ("interface.measures.zone_ends", "Dundurs' constant beta of two materials"),
        "recovered_tractions": ("evolution.moment", "Tractions without the zigzag of order 2"),
        "traction_at": ("interface.measures.tractions", "Traction between the nodes"),
        "loop_of": ("output.plots.loops", "Hysteresis loop of each load in a cycle, and its area"),
        "refined_at_zone_ends": ("accuracy.zone_end_mesh", "Scene with mesh graded by record"),
        "headline": ("accuracy.numbers", "Headline numbers of a record"),
        "HEADLINE_NAMES": ("scene.options:NUMBERS", "Headline numbers in words"),
        "Number": ("accuracy.numbers", "Headline number, and what it is known to"),
        "space_errors": ("accuracy.space_errors", "Estimate discretisation errors"),
        "scaled_mesh": ("accuracy.meshes:scaled", "Scene with all mesh sizes scaled alike"),
        "graded_at_ends": ("accuracy.meshes", "Scene with meshes graded to ends of contact edges"),
        "level_of": ("accuracy.space_errors", "Level of a record: its mesh and headline numbers"),
        "Level": ("accuracy.estimate", "What a run on one mesh of a family found"),
        "estimates_of": ("accuracy.estimate", "Estimate errors from levels of one family"),
        "Estimate": ("accuracy.estimate", "Number with its estimated error and order"),
    },
    "Report and pictures": {
        "summarise": ("output.report.summary", "Return the numbers of summary.json"),
        "read_summary": ("output.storage.summary_file", "Read summary.json"),
        "run_table": ("output.report.text", "Return the table that a run prints"),
        "write_report": ("output.report.html", "Write report.html of a run folder"),
        "figures": ("output.plots.figures:", "Matplotlib figures of a record (module)"),
        "style": ("output.plots.style:", "Colours, fonts and sizes of the figures (module)"),
        "plot": ("pictures", "Draw all figures of a run and its report"),
        "snapshot": ("pictures", "Draw the body of a finished run at one instant"),
        "draw_slip_mode": ("pictures", "Draw the body in the slip mode at critical friction"),
        "animate": ("pictures", "Make a film of one cycle of a finished run"),
        "export": ("output.storage.fclib", "Write a load step in the layout of FCLIB"),
    },
    "Shakedown and other starts": {
        "shakedown_limits": ("interface.shakedown.limits", "Both shakedown limits of a load range"),
        "ShakedownLimits": ("interface.shakedown.limits", "Limits, safe slip, what binds"),
        "ShakedownOptions": ("scene.model", "Load range of a scene: mean and corners"),
        "shakedown": ("shakedown_study.study", "Limits of a scene, on two meshes, with diagram"),
        "ShakedownStudy": ("shakedown_study.result", "Result of shakedown"),
        "opening_limit": ("shakedown_study.opening", "Largest range of a contact that opens"),
        "range_history": ("shakedown_study.cycles", "History round the corners of a load range"),
        "steady_states": ("evolution.limit.starts", "Steady states from many initial slips"),
        "steady_states_figure": ("shakedown_study.figures", "Figure of these"),
        "SteadyStates": ("evolution.limit.starts", "Their dissipation, kinds and zones"),
    },
    "Known solutions": {
        "reference": ("reference:", "closed_forms, fretting, layer, ahn_barber (modules)"),
    },
    "Errors": {
        "RecedingError": ("errors", "Base class of all errors raised on purpose"),
        "InputError": ("errors", "A scene, an option or a file cannot be used"),
        "SolveError": ("errors", "A solver failed its own checks"),
        "ToleranceNotMet": ("errors", "A run ended before its numbers met the tolerance"),
        "NotConverged": ("errors", "An iteration ran out of sweeps"),
        "NoEquilibrium": ("errors", "No equilibrium: lift-off or gross sliding"),
        "NoQuasiStaticContinuation": ("errors", "The quasi-static path ends in a jump"),
        "Interrupted": ("errors", "Ctrl-C or a signal; the run can be resumed"),
    },
    "MPI": {
        "on_root": ("mpi", "Run a function on rank 0; raise its error on all ranks"),
        "on_all": ("mpi", "Run a function on all ranks; raise an error of any on all"),
        "given": ("mpi", "Return a value of rank 0, asserting that it is not None"),
        "child_environment": ("environment", "Environment of a child process outside this MPI job"),
    },
}
_NAMES = {name: entry for group in _PUBLIC.values() for name, entry in group.items()}

__all__ = sorted(_NAMES)


def _listing() -> str:
    """Return the public names by groups, each with its description, for the docstring."""
    lines = ["", "Public names"]
    for group, names in _PUBLIC.items():
        shown = (f"    {name:26}  {text}" for name, (_, text) in names.items())
        lines += ["", f"{group}::", "", *shown]
    return "\n".join(lines) + "\n"


__doc__ = f"{__doc__}{_listing()}"


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used: DOLFINx, MPI and displays are loaded late."""
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    place, colon, inner = _NAMES[name][0].partition(":")
    module = import_module(f"{__name__}.{place}")
    return module if colon and not inner else getattr(module, inner or name)


def __dir__() -> list[str]:
    """Return the public names and the module's own attributes."""
    return sorted([*_NAMES, *(name for name in globals() if name.startswith("__"))])
