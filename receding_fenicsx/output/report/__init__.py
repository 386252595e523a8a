"""Numbers of a run: summary, console table, HTML report, error estimates.

1. ``summary.summarise`` makes the contents of ``summary.json`` from a record, with half widths of
   ``half_widths.half_widths`` and ``half_widths.estimates``.
2. ``space_errors.errors_of_run`` estimates discretisation errors with runs on coarser meshes.
3. ``text.run_table`` makes the table on the console, ``html.write_report`` the report
   (``html_pictures``, ``html_elements``).
"""
