"""Replay of whole cycles: the same path as from event to event, whatever was foreseen."""

from itertools import pairwise

import numpy as np
import pytest
from models import block_system

from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.replay import rounds
from receding_fenicsx.interface.residual import law_residual, local_stiffness
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg, reactions

pytestmark = pytest.mark.one_rank

LOOP = np.array([[1.0], [1.0 / 3.0], [1.0]])


def play(
    system: ContactSystem, cycles: int, then: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
) -> list[Leg]:
    """Follow cycles of the block, and then other legs."""
    path, n, scale = EventPath(system), system.n, 0.0
    now = ContactState(np.zeros(2 * n), np.zeros(2 * n), np.ones(n, np.int8))
    legs = []
    for a, b in [(np.zeros(1), LOOP[0]), *(cycles * list(pairwise(LOOP))), *then]:
        legs.append(path.trace_leg(now, (a, b), scale))
        now, scale = legs[-1].end, legs[-1].force_scale
    return legs


def without(monkeypatch: pytest.MonkeyPatch, system: ContactSystem, cycles: int) -> list[Leg]:
    """Follow the same cycles from event to event."""
    with monkeypatch.context() as patch:
        patch.setattr(rounds.Rounds, "leg", lambda *_: None)
        return play(system, cycles)


def assert_same(legs: list[Leg], others: list[Leg], system: ContactSystem) -> None:
    """Assert that two paths have the same events, and the same forces to round-off."""
    force = others[-1].force_scale
    for leg, other in zip(legs, others, strict=True):
        assert sorted(event[1:] for event in leg.events) == sorted(e[1:] for e in other.events)
        places = [np.sort([event[0] for event in one.events]) for one in (leg, other)]
        assert np.abs(places[0] - places[1]).max(initial=0.0) < 1e-9
        assert np.array_equal(leg.end.state, other.end.state)
        assert np.abs(leg.end.r - other.end.r).max() <= 1e-11 * force
        assert leg.dissipation == pytest.approx(other.dissipation, abs=1e-11 * force)
        assert leg.work == pytest.approx(other.work, rel=1e-9)
        assert leg.force_scale == pytest.approx(other.force_scale, rel=1e-12)
    for leg, (_, b) in zip(legs[1:], 2 * list(pairwise(LOOP)), strict=False):
        end = leg.end
        assert np.abs(reactions(system, b, end.u) - end.r).max() <= 1e-14 * force
        error = law_residual(system, end.r, end.u, np.zeros(system.n), local_stiffness(system))
        assert error.max() <= 1e-11 * force


def test_cycles_at_once_are_those_from_event_to_event(monkeypatch: pytest.MonkeyPatch) -> None:
    system, foreseen = block_system(80, 40), []
    plain = without(monkeypatch, system, 60)
    found = rounds.Rounds.leg

    def counting(self: rounds.Rounds, *args: object) -> Leg | None:
        leg = found(self, *args)  # type: ignore[arg-type]
        foreseen.append(leg is not None)
        return leg

    monkeypatch.setattr(rounds.Rounds, "leg", counting)
    assert_same(play(system, 60), plain, system)
    assert np.count_nonzero(foreseen) > 10


@pytest.mark.parametrize("error", [1e-6, 1e-9])
def test_ends_foreseen_wrongly_are_not_taken(error: float, monkeypatch: pytest.MonkeyPatch) -> None:
    system, play_on, taken = block_system(80, 40), rounds.play, []
    plain = without(monkeypatch, system, 40)

    def misled(*args: object) -> list[tuple[np.ndarray, ...]]:
        rows = play_on(*args)  # type: ignore[arg-type]
        return [(y, h, at, end * (1.0 + error)) for y, h, at, end in rows]

    found = rounds.Rounds._verified

    def counting(self: rounds.Rounds, *args: object) -> list[Leg]:
        legs = found(self, *args)  # type: ignore[arg-type]
        taken.append(len(legs))
        return legs

    monkeypatch.setattr(rounds, "play", misled)
    monkeypatch.setattr(rounds.Rounds, "_verified", counting)
    assert_same(play(system, 40), plain, system)
    assert taken and not any(taken)


def test_events_that_no_longer_come_are_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    system, note, foresee, refused = (
        block_system(80, 40),
        rounds.Rounds.note,
        rounds.Rounds._foresee,
        0,
    )
    plain = without(monkeypatch, system, 40)

    def keeping(self: rounds.Rounds, *args: object) -> None:
        before = dict(self._known)
        note(self, *args)  # type: ignore[arg-type]
        self._known.update(before)

    def counting(self: rounds.Rounds, *args: object) -> None:
        nonlocal refused
        foresee(self, *args)  # type: ignore[arg-type]
        refused += not self._ready

    monkeypatch.setattr(rounds.Rounds, "note", keeping)
    monkeypatch.setattr(rounds.Rounds, "_foresee", counting)
    assert_same(play(system, 40), plain, system)
    assert refused > 0


@pytest.mark.parametrize("cycles", [8, 40, 42, 45])
def test_a_leg_carries_the_load_that_is_asked_for_whatever_was_played_before(
    cycles: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, other = block_system(80, 40), np.array([0.6])
    then = ((LOOP[0], other), (other, LOOP[0]))
    legs = play(system, cycles, then)
    monkeypatch.setattr(rounds.Rounds, "leg", lambda *_: None)
    for leg, plain, (_, b) in zip(legs[-2:], play(system, cycles, then)[-2:], then, strict=True):
        assert np.abs(reactions(system, b, leg.end.u) - leg.end.r).max() <= 1e-14 * leg.force_scale
        assert np.abs(leg.end.r - plain.end.r).max() <= 1e-11 * leg.force_scale
        assert leg.work == pytest.approx(plain.work, rel=1e-9)
