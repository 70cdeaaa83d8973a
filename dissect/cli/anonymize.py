"""`s7dissect anonymize`: a capture that can be shared, and a summary of the replacements."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dissect.cli.formats import format_option, write_out
from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.options.scd import scd_options
from dissect.cli.run import complain, drive
from dissect.cli.second_pass import check_files, name_of, written_whole
from dissect.meaning.report.formats import OUTCOME, Format
from dissect.meaning.report.outcome import WIDE_PAGE, Outcome

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
    from dissect.files.anonymize.account import Account, Choices
    from dissect.files.anonymize.addresses import AddressMap
    from dissect.files.anonymize.key import Key
    from dissect.files.anonymize.survey import Survey

_EXIT_CODES = (
    "Exit code: 0 success, 2 wrong use, an unreadable or unwritable file, or nothing to write, 3 a damaged or truncated file "
    "(what could be read was written), 5 the output could not be written (disk full), 130 interrupted (nothing written)."
)


def _key(_ctx: click.Context, _param: click.Parameter, value: str) -> Key:
    from dissect.files.anonymize.key import random_key, read_key

    if value == "random":
        return random_key()
    try:
        return read_key(value)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise click.ClickException(f"--key {value}: {why}") from None


@click.command("anonymize", epilog=_EXIT_CODES)
@click.argument("file", type=click.Path(readable=False), metavar="FILE")
@click.option(
    "-o", "--output", "output", required=True, metavar="OUT", help="The pcapng file to write; - is standard output."
)
@click.option(
    "--key",
    default="random",
    show_default=True,
    callback=_key,
    metavar="FILE|random",
    help="Secret that determines all replacements: the same key gives the same replacements in other captures. Keep it "
    "private: whoever has it can test guesses. A random key is not stored.",
)
@click.option(
    "--values",
    type=click.Choice(("mask", "scramble", "keep")),
    default="mask",
    show_default=True,
    help="Process values: replace by zeros (mask) or by other values of the same size (scramble), or keep.",
)
@click.option("--keep-code", is_flag=True, help="Keep the contents of downloaded and uploaded blocks and files.")
@click.option(
    "--keep-others",
    is_flag=True,
    help="Also write packets of other protocols, with replaced addresses and zeroed contents, so that packet numbers stay the "
    "same; by default they are dropped.",
)
@click.option(
    "--shift-time", is_flag=True, help="Shift all times into the future, by an offset that the key determines."
)
@format_option(OUTCOME, help="Format of the account of the replacements")
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists (never FILE).")
@scd_options
def command(
    file: str,
    output: str,
    key: Key,
    values: str,
    keep_code: bool,
    keep_others: bool,
    shift_time: bool,
    format_: Format,
    force: bool,
    decoder: PayloadDecoder | None,
) -> int:
    """Write a copy of a capture that can be shared, and report what was replaced in it.

    Addresses, TSAP texts, names, serial numbers, passwords and values are replaced by others of the same size; data that is not
    understood becomes zeros. Sizes, times, pairing, error codes and requested addresses are kept, so an analysis gives the same
    results. Correct checksums stay correct. FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; it is read
    twice.
    """
    from dissect.engine.pipeline import Options
    from dissect.files.anonymize.account import Account, Choices
    from dissect.files.anonymize.addresses import AddressMap
    from dissect.files.anonymize.plus import PlusRules
    from dissect.files.anonymize.plus_contents import PlusContents
    from dissect.files.anonymize.rules import Rules
    from dissect.files.anonymize.scd import ScdRules, bindings_of
    from dissect.files.anonymize.survey import Survey
    from dissect.files.session import Run
    from dissect.meaning.bindings.engine import ScdCarrier

    check_files((file,), output, force)
    choices = Choices(values, keep_code, keep_others, shift_time)
    account = Account()
    addresses = AddressMap(key)
    scd = decoder if isinstance(decoder, ScdCarrier) else None
    rules = Rules(key, addresses, choices, ScdRules(key, addresses, choices, scd, account))
    plus = PlusRules(PlusContents(key, choices, account), account)
    survey = Survey(key, rules, plus, account, scd)
    run = Run((file,), survey, Options(decoder=scd))
    code = drive(run, (file,))
    if code == EXIT_INTERRUPTED:
        click.echo(f"s7dissect: interrupted; {name_of(output)} was not written", err=True)
        return code
    complain(run, code)
    survey.settle()
    _write(file, output, survey, addresses, choices, account, key.shift_ns if choices.shift_time else 0)
    if scd is not None:
        account.bindings = bindings_of(scd.bindings, key, addresses)
    for kind, count in addresses.changed.items():
        if count:
            account.replaced[kind] = count
    lines = format_.lines(OUTCOME, _Replaced(account))
    if output == "-":
        click.echo("\n".join([line if isinstance(line, str) else line.text for line in lines]), err=True)
    else:
        write_out(lines)
    return code


class _Replaced(Outcome):
    """The summary of the replacements."""

    layout = WIDE_PAGE

    def __init__(self, account: Account) -> None:
        self._account = account

    def text(self) -> list[str]:
        """Return it for a person."""
        return self._account.lines()

    def as_dict(self) -> dict[str, object]:
        """Return it as values."""
        return self._account.as_dict()


def _write(
    file: str, output: str, survey: Survey, addresses: AddressMap, choices: Choices, account: Account, shift_ns: int
) -> None:
    """Read the file again and write the anonymized copy."""
    from dissect.files.anonymize.packet import Packets
    from dissect.files.anonymize.rewriter import Rewriter
    from dissect.packets.source.files import open_capture

    with written_whole(output, "anonymize") as writer:
        rewriter = Rewriter(Packets(survey, addresses, choices, account), writer, account, shift_ns)
        reader = open_capture(file)
        try:
            while reader.step(rewriter):
                pass
        finally:
            reader.close()
        rewriter.finish()
        if not account.written:
            raise click.ClickException(
                "the capture contains no S7 packets; nothing was written (--keep-others writes other packets)."
            )
