"""Reports of a run: ``summary.json``, the console and ``report.html``, section by section.

1. A :class:`~receding_fenicsx.output.report.section.Section` makes its keys of the summary from a
   record, and its table and its lines for the console from the summary.
2. ``summary.SECTIONS`` lists the sections of ``turning_points``, ``cycles``, ``checks`` and
   ``run``; ``summary.summarise`` returns the keys of all.
3. Two renderers: ``summary.run_table`` for the console, ``html.write_report`` for the page, whose
   template is ``template.html``.
"""
