"""Matplotlib figures of a record (tractions, zones, cycles, loops and paths of nodes).

1. ``figures.plot_all`` chooses the figures that a record has data for and saves them.
2. ``traction_plots.tractions``, ``zones.zone_plots.zone_maps``, ``zones.cycle_maps.cycle_maps``,
   ``cycle_plots``, ``loop_plots`` and ``probe_plots`` draw them; ``selection`` validates requested
   cycles, legs and nodes.
3. Their data come from ``series`` and ``loops``; ``touching.shown_states`` decides which slips are
   negligible.
4. ``units.scales_of`` chooses units and labels, with ``load_kinds`` and ``load_names``;
   ``descriptions`` writes titles, ``style`` has colours, fonts and sizes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["figures", "style"])
