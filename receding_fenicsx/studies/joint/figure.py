"""Figure of a joint: dissipation and secant stiffness over the amplitude."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import load_text
from receding_fenicsx.studies.joint.result import JointCurve


def joint_figure(curve: JointCurve) -> Figure:
    """Draw D and the secant stiffness over the amplitude, with Masing's rule and the exponent."""
    a, D, stiffness = curve.amplitude, curve.dissipation, curve.stiffness
    labels, unit = ("dissipation per cycle $D$", "secant stiffness"), np.ones(len(a))
    if curve.is_mode:
        labels = (r"damping ratio $\zeta$", r"angular frequency $\omega$")
        stiffness, unit = curve.omega, stiffness / (2.0 * np.pi * a**2)
    slope, _ = curve.exponent
    blue, orange = style.SERIES_COLOURS[:2]
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.PAGE, 2.9)
        left, right = figure.subplots(1, 2)
        fit = f", exponent of D {slope:.2f}" if np.isfinite(slope) else ""
        left.errorbar(
            a,
            unit * D,
            np.nan_to_num(unit * curve.estimate),
            fmt="o",
            ms=3,
            color=blue,
            label=f"limit cycle{fit}",
        )
        left.plot(a, unit * curve.masing, color=orange, label="Masing's rule")
        left.set(xscale="log", ylabel=labels[0])
        if np.any(D > 0.0):
            left.set_yscale("log")
        right.plot(a, stiffness, "o-", ms=3, color=blue, label="limit cycle")
        right.set(xscale="log", ylabel=labels[1])
        for axes in (left, right):
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_xlabel(f"amplitude of {load_text(curve.drive)}")
            if np.isfinite(curve.backbone.macroslip):
                axes.axvline(curve.backbone.macroslip, label="macroslip", **style.GUIDE)
        left.legend(loc="upper left")
    return figure
