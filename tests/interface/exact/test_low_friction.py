"""Friction near zero: in the limit every node slips as without it, and D = f sum P |dv|."""

import re
from dataclasses import replace

import numpy as np
import pytest
from models import block_system
from replay import objections
from small import cyclic

from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

WHOLE = block_system(32, 6, half=False)
ALL = OutputOptions(samples_per_leg=16, cycles="all")


@pytest.mark.parametrize("f", [1e-2, 1e-4, 1e-5, 1e-6])
def test_a_block_unloaded_to_zero_dissipates_f_times_its_frictionless_slip(f: float) -> None:
    slip = evolve(replace(WHOLE, f=np.zeros(WHOLE.n)), cyclic(0)).turning_points
    v = slip.v[0] - slip.v[0, WHOLE.n // 2]
    # P and v grow with the load: a leg to or from zero takes half of the product at its end
    leg = 0.5 * f * float(np.sum(slip.P[0] * np.abs(v)))
    system = replace(WHOLE, f=np.full(WHOLE.n, f))
    record = evolve(system, cyclic(2, minimum=0.0), output=ALL)
    assert objections(system, cyclic(2, minimum=0.0), record) == []
    assert record.energy_error_max <= 1e-10
    assert record.dissipation_first_loading == pytest.approx(leg, rel=30.0 * f)
    assert record.cycles.dissipation == pytest.approx([2.0 * leg] * 2, rel=30.0 * f)


@pytest.mark.parametrize("on_jump", ["stop", "static"])
@pytest.mark.parametrize("minimum", [0.0, 1.0 / 3.0])
@pytest.mark.parametrize("f", [1e-8, 1e-10, 1e-12])
def test_friction_lost_in_round_off_is_named(f: float, minimum: float, on_jump: str) -> None:
    # the outer nodes lift off: their friction does not matter
    system = replace(WHOLE, f=np.where(np.abs(WHOLE.x) < 1.99, f, 0.5))
    try:
        record = evolve(system, cyclic(1, minimum), SolverOptions(on_jump=on_jump), ALL)
    except SolveError as error:
        # neither does the body lift off, nor does it jump
        assert not isinstance(error, NoEquilibrium | NoQuasiStaticContinuation)
        said = (
            rf"^cycle \d, leg \d: .* {system.load_names[0]} = \S+: .* f = {f:.2g} of node (\d+) is"
        )
        node = re.search(said + r" .*; make it 0, or 1e-05 at least", str(error))
        assert node is not None and system.f[int(node[1])] == f
    else:
        assert objections(system, cyclic(1, minimum), record) == [] and record.jumps == 0
