"""Matplotlib figures of a record (tractions, zones, cycles, loops and paths of nodes).

1. ``figures.plot_all`` chooses the figures that a record has data for and saves them.
2. ``traction_plots`` (with probes), ``zone_plots`` and ``cycle_plots`` draw them; ``study_plots``
   draws those of branches and of searches for a tolerance.
3. Their data come from ``series`` and ``zone_map``.
4. ``labels.Scales`` chooses units and labels; ``style`` has colours, fonts and sizes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["figures", "style"])
