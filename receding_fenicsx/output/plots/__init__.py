"""Matplotlib figures of a record (Figs. 4 to 10 of the paper, loops and paths of nodes).

1. ``figures.plot_all`` chooses the figures that a record has data for and saves them.
2. ``traction_plots.tractions``, ``zone_plots.zone_maps`` (one panel for each leg),
   ``cycle_maps.cycle_maps`` (one map for each cycle), ``cycle_plots`` and ``loop_plots`` draw them;
   ``selection`` validates requested cycles, legs and nodes.
3. Their data come from ``series``, ``loops``, ``timelines.timelines_of`` and ``zone_map``;
   ``touching.shown_states`` decides which slips are negligible.
4. ``units.scales_of`` chooses units and labels, ``style`` colours, fonts and sizes;
   ``zone_labels.place_labels`` places the numbers of states.
"""
