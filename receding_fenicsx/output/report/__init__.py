"""Reports of a run: ``summary.json``, the console and ``report.html``, section by section.

1. A :class:`~receding_fenicsx.output.report.section.Section` makes its keys of the summary from a
   record, and its table and its lines for the console from the summary.
2. ``summary.SECTIONS`` lists the sections: ``turning_points``, ``cycles``, ``forces``, ``checks``,
   ``accuracy`` and ``run``; ``summary.summarise`` returns the keys of all.
3. Two renderers: ``text.run_table`` for the console, ``html.write_report`` for the page (its
   template is ``template.html``, its pictures come from ``html_pictures``).
"""
