"""Numbers of a run: summary, console table, HTML report, error estimates.

1. ``summary.summarise`` makes the contents of ``summary.json`` from a record, with half widths of
   ``half_widths.half_widths`` and ``half_widths.half_width_estimates``.
2. ``accuracy.error_rows`` and ``accuracy.way_lines`` show estimated errors and how they were met.
3. ``text.run_table`` makes the table on the console, ``html.write_report`` the report
   (``html_pictures``, ``html_elements``).
"""
