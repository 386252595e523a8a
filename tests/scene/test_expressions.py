import math
from collections.abc import Callable

import numpy as np
import pytest

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.profiles import evaluate_expression

pytestmark = pytest.mark.one_rank


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2", lambda x, y: 2 + 0 * x),
        ("-x**2/3 + pi", lambda x, y: -(x**2) / 3 + math.pi),
        ("x*y - (x - 1)*+2", lambda x, y: x * y - (x - 1) * 2),
        ("min(x, 0.5, y) + max(x, -0.25)", lambda x, y: min(x, 0.5, y) + max(x, -0.25)),
        ("abs(x) + sqrt(abs(x))", lambda x, y: abs(x) + math.sqrt(abs(x))),
        ("sin(x) + cos(y)*tanh(x)", lambda x, y: math.sin(x) + math.cos(y) * math.tanh(x)),
        ("exp(-x) + log(2 + x)", lambda x, y: math.exp(-x) + math.log(2 + x)),
        ("where(x > 0, 1, 2)", lambda x, y: 1.0 if x > 0 else 2.0),
        ("(-0.5 <= x < 0.5) + (x == 1)", lambda x, y: (-0.5 <= x < 0.5) + (x == 1)),
        ("2*(x != y)", lambda x, y: 2.0 * (x != y)),
        ("  1e-3 ", lambda x, y: 1e-3),
    ],
)
def test_expression_has_pythons_value(text: str, expected: Callable[[float, float], float]) -> None:
    x = np.array([-1.0, -0.5, 0.0, 0.25, 1.0])
    y = np.array([0.5, -0.5, 2.0, 0.25, -1.0])
    wanted = [expected(a, b) for a, b in zip(x, y, strict=True)]
    np.testing.assert_allclose(evaluate_expression(text, x, y), wanted, rtol=1e-15, atol=1e-16)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("__import__('os').system('true')", "not allowed"),
        ("x.__class__", "not allowed"),
        ("'a'", "not allowed"),
        ("True", "not allowed"),
        ("x^2", "write ** for a power"),
        ("open(x)", "unknown name 'open'"),
        ("sqr(x)", "did you mean 'sqrt'?"),
        ("sin(x, x)", "takes 1 argument"),
        ("y", "only x"),
        ("", "not an expression"),
        ("x = 1", "not an expression"),
        ("9**9**9**9", "finite"),
        ("sqrt(x)", "finite"),
        ("1" + 400 * "0", "too large"),
        (1001 * "1", "characters"),
        ("\0", "not an expression"),
    ],
)
def test_other_text_is_no_expression(text: str, word: str) -> None:
    with pytest.raises(InputError) as caught:
        evaluate_expression(text, np.array([-1.0, 1.0]))
    assert word in str(caught.value)


def test_long_sums_are_refused_or_right_but_never_crash() -> None:
    text = "+".join(400 * ["x"])
    np.testing.assert_allclose(evaluate_expression(text, np.array([0.5])), [200.0])
    with pytest.raises(InputError):
        evaluate_expression(999 * "-" + "x", np.array([0.5]))
