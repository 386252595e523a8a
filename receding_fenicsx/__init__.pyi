"""Public names of ``import receding_fenicsx as rf``, each loaded when it is first used."""

__version__: str
__all__: list[str]

# Scene
from .scene.model import (
    Scene as Scene,
    Body as Body,
    Material as Material,
    MeshOptions as MeshOptions,
    Refinement as Refinement,
    Contact as Contact,
    Load as Load,
    Bolt as Bolt,
    Spring as Spring,
    Support as Support,
    Tie as Tie,
    Probe as Probe,
    HistoryOptions as HistoryOptions,
    Harmonic as Harmonic,
    SolverOptions as SolverOptions,
    AccuracyOptions as AccuracyOptions,
    FatigueOptions as FatigueOptions,
    ModeOptions as ModeOptions,
    OutputOptions as OutputOptions,
)
from .scene.options import Units as Units
from .scene.toml_file import read_scene as read_scene, from_toml as from_toml, to_toml as to_toml
from .scene.validate import validate as validate, scene_warnings as scene_warnings
from .scene.history import History as History, history_from_scene as history_from_scene

# Contact system
from .studies.run import condense as condense
from .interface.system import (
    ContactSystem as ContactSystem,
    ContactState as ContactState,
    reactions as reactions,
)
from .interface.law import State as State, STATE_NAMES as STATE_NAMES
from .store.hdf5 import read_system as read_system, write_system as write_system
from .exchange.importing import import_system as import_system
from .exchange.reduced import reduced_model as reduced_model, ReducedModel as ReducedModel

# Run
from .studies.run import run as run, RunOptions as RunOptions
from .evolution.evolve import evolve as evolve
from .evolution.solvers import Solver as Solver, SOLVERS as SOLVERS
from .interface.system import Leg as Leg
from .evolution.record import Record as Record
from .evolution.probes import ProbeHistory as ProbeHistory
from .store.hdf5 import read_record as read_record, write_record as write_record
from .evolution.replay import instant_of as instant_of, state_at as state_at

# Several continuations
from .evolution.branches import branches as branches, BranchTree as BranchTree, Branch as Branch
from .interface.branches.critical_friction import (
    critical_friction as critical_friction,
    CriticalFriction as CriticalFriction,
)

# Sweep
from .studies.runner import StudyOptions as StudyOptions
from .studies.sweep import sweep as sweep, SweepTable as SweepTable

# Joints
from .studies.joint.curve import joint_curve as joint_curve, JointCurve as JointCurve
from .studies.joint.fits import (
    fit_iwan as fit_iwan,
    fit_jenkins as fit_jenkins,
    JointFit as JointFit,
)
from .studies.joint.curve import joint_figure as joint_figure

# Evaluation
from .interface.measures.zones import (
    zones as zones,
    contact_half_width as contact_half_width,
    stick_half_width as stick_half_width,
)
from .measures.ends import half_widths as half_widths, half_width_estimates as half_width_estimates
from .interface.measures.zone_ends import dundurs_beta as dundurs_beta
from .evolution.moment import recovered_tractions as recovered_tractions
from .interface.measures.tractions import traction_at as traction_at
from .measures.fatigue import (
    EdgeCrack as EdgeCrack,
    edge_crack as edge_crack,
    fatigue as fatigue,
    fatigue_at as fatigue_at,
    life_by_pylife as life_by_pylife,
    short_cracks as short_cracks,
)
from .output.plots.series import loop_of as loop_of
from .studies.accuracy.estimate import headline as headline, Number as Number
from .scene.options import HEADLINE_NAMES as HEADLINE_NAMES
from .studies.accuracy.study import space_errors as space_errors
from .studies.accuracy.meshes import (
    scaled_mesh as scaled_mesh,
    graded_at_ends as graded_at_ends,
    refined_at_zone_ends as refined_at_zone_ends,
)
from .studies.accuracy.estimate import (
    Level as Level,
    level_of as level_of,
    estimates_of as estimates_of,
    Estimate as Estimate,
)

# Report and pictures
from .output.report.summary import summarise as summarise
from .store.run_folder import read_summary as read_summary
from .output.report.summary import run_table as run_table, write_report as write_report
from .output.plots import figures as figures, style as style
from .pictures import (
    plot as plot,
    snapshot as snapshot,
    draw_slip_mode as draw_slip_mode,
    animate as animate,
)
from .store.fclib import export as export

# Shakedown and other starts
from .interface.shakedown.limits import (
    shakedown_limits as shakedown_limits,
    ShakedownLimits as ShakedownLimits,
)
from .scene.model import ShakedownOptions as ShakedownOptions
from .studies.shakedown.study import shakedown as shakedown, ShakedownStudy as ShakedownStudy
from .studies.shakedown.exact_cycles import opening_limit as opening_limit
from .studies.shakedown.exact_cycles import range_history as range_history
from .studies.starts import steady_states as steady_states, SteadyStates as SteadyStates
from .studies.starts import steady_states_figure as steady_states_figure

# Wear
from .scene.model import WearOptions as WearOptions
from .studies.wear.study import wear as wear
from .studies.wear.study import WearStudy as WearStudy

# Known solutions
from . import reference as reference

# Errors
from .errors import (
    RecedingError as RecedingError,
    InputError as InputError,
    SolveError as SolveError,
    ToleranceNotMet as ToleranceNotMet,
    NotConverged as NotConverged,
    NoEquilibrium as NoEquilibrium,
    NoQuasiStaticContinuation as NoQuasiStaticContinuation,
    Interrupted as Interrupted,
)

# MPI
from .mpi import on_root as on_root, on_all as on_all, given as given
from .environment import child_environment as child_environment
