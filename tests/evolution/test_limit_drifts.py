"""Whether nodes come to a limit, and none slips beyond it: against drifts in closed form."""

import numpy as np
import pytest

from receding_fenicsx.evolution.limit.drifts import OVERSHOT, has_settled

pytestmark = pytest.mark.one_rank


def settles(lacking: np.ndarray) -> int | None:
    """Return the first cycle at whose end drifts (n, k) are known to come to their limit."""
    least = np.full(lacking.shape[1], OVERSHOT)
    known = (n for n in range(3, len(lacking)) if has_settled(lacking[n - 3 : n + 1], least))
    return next(known, None)


@pytest.mark.parametrize("decay", [0.02, 0.5, 0.9, 0.99])
def test_drifts_of_one_shape_come_to_their_limit(decay: float) -> None:
    lacking = np.outer(decay ** np.arange(5.0), [1.0, 0.3, 1e-4])
    assert settles(lacking) == 3
    assert settles(-lacking) == 3  # free nodes: theirs may have either sign
    assert settles(1.0 / lacking) is None


@pytest.mark.parametrize("seed", range(12))
def test_no_node_that_passes_its_limit_is_taken_to_come_there(seed: int) -> None:
    # node 0 lacks a^n - C b^n, which changes sign; at node 1 the slower decay may not show at first
    rng = np.random.default_rng(seed)
    a, b = np.sort(rng.uniform(0.1, 0.9, 2))
    n, C, other = np.arange(300.0)[:, None], *10.0 ** rng.uniform(-9.0, [-1.0, 0.0])
    passes = np.hstack([a**n - C * b**n, a**n + other * b**n])
    beyond, known = np.flatnonzero(passes[:, 0] < -10.0 * OVERSHOT), settles(passes)
    assert len(beyond) == 0 or known is None or known >= beyond[0]
    # the same with the other sign comes there
    stays = np.hstack([a**n + C * b**n, a**n + other * b**n])
    known = settles(stays)
    assert known is not None and known < 300


@pytest.mark.parametrize("seed", range(12))
def test_no_node_that_comes_to_rest_before_its_limit_is_taken_to_come_there(seed: int) -> None:
    rng = np.random.default_rng(seed)
    decay, rest = rng.uniform(0.1, 0.9), 10.0 ** rng.uniform(-4.0, 1.0)
    lacking = rest + decay ** np.arange(300.0)[:, None]
    known = settles(lacking)
    # what is left of the drift is then most of what it lacks
    assert known is None or lacking[known, 0] > 5.0 * rest


def test_what_free_nodes_forget_is_waited_for() -> None:
    n = np.arange(200.0)
    drift, memory = 0.9**n, np.cos(n) * 0.7**n
    known = settles(np.stack([drift, memory], axis=1))
    assert known is not None and abs(memory[known]) < OVERSHOT
    slaved = settles(np.stack([drift, -0.3 * drift], axis=1))
    assert slaved == 3
