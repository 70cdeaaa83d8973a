"""`s7dissect analyze`: what a capture holds, how fast it went, what failed and why."""

from __future__ import annotations

import click

from dissect.cli.drive import complain, drive, files_argument, format_option, slow_option, styler, write


@click.command("analyze")
@files_argument
@format_option("text", "json")
@slow_option
def command(files: tuple[str, ...], format_: str, slow_ms: float) -> int:
    """Tell what FILE... hold: connections, transactions by function, findings, loss.

    Several files are read one after another; files of a ring buffer continue each other. - is standard input.
    """
    from dissect.conversation import Options
    from dissect.report.analysis import Analysis
    from dissect.session import Run

    analysis = Analysis()
    run = Run(files, analysis, Options(int(slow_ms * 1e6)))
    code = drive(run, files)
    analysis.take(run.pipeline, run.files)
    if format_ == "json":
        import json

        write([json.dumps(analysis.as_dict(), indent=1)])
    else:
        from dissect.report.text import analysis_lines

        write(analysis_lines(analysis, styler()))
    complain(run, code)
    return code
