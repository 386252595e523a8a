"""Reports of a run: ``summary.json``, the console and the file report.html, section by section.

1. A :class:`~receding_fenicsx.output.report.section.Section` makes its keys of the summary from a
   record, and its table and its lines for the console from the summary.
2. ``summary.SECTIONS`` lists those of ``contact`` and ``run``; ``summarise`` returns all keys.
3. Two renderers: ``summary.run_table`` for the console, ``write_report`` for the page.
"""
