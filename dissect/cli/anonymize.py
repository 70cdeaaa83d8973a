"""`s7dissect anonymize`: a capture that may be shown to others, and an account of what it no longer tells."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.options.scd import scd_options
from dissect.cli.run import complain, drive, write
from dissect.cli.second_pass import check_files, name_of, written_whole
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.anonymize.account import Account, Choices
    from dissect.anonymize.addresses import AddressMap
    from dissect.anonymize.key import Key
    from dissect.anonymize.survey import Survey
    from dissect.engine.payload import PayloadDecoder

_EXIT_CODES = (
    "Exit code: 0 written, 2 wrong use, a file that cannot be read or written, or nothing to write, 3 a file is damaged or cut "
    "off (what could be read was written), 5 standard output failed, 130 interrupted (nothing written)."
)


def _key(ctx: click.Context, param: click.Parameter, value: str) -> Key:
    from dissect.anonymize.key import random_key, read_key

    if value == "random":
        return random_key()
    try:
        return read_key(value)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise click.BadParameter(f"{printable(value)}: {printable(reason)}.", ctx, param) from None


@click.command("anonymize", epilog=_EXIT_CODES)
@click.argument("file", type=click.Path(), metavar="FILE")
@click.option(
    "-o", "--output", "output", required=True, metavar="OUT", help="The pcapng file to write; - is standard output."
)
@click.option(
    "--key",
    default="random",
    show_default=True,
    callback=_key,
    metavar="FILE|random",
    help="Octets that all replacements depend on: the same key replaces the same by the same in other captures too. Keep it: "
    "who has it can try guesses. A random one is never written down.",
)
@click.option(
    "--values",
    type=click.Choice(("mask", "scramble", "keep")),
    default="mask",
    show_default=True,
    help="Values read, written and sent: zeros, others of the same size (the same for the same), or as they are.",
)
@click.option(
    "--keep-code", is_flag=True, help="Leave the contents of blocks and files in down- and uploads as they are."
)
@click.option(
    "--keep-others",
    is_flag=True,
    help="Write packets of other protocols too, with other addresses and zeros for contents, so that all packets keep their "
    "numbers; else they are dropped.",
)
@click.option("--shift-time", is_flag=True, help="Move all packets into the future, by a time that depends on the key.")
@click.option("-T", "--format", "format_", type=click.Choice(("text", "json")), default="text", show_default=True,
              help="How to tell what was changed and what was left.")  # fmt: skip
@click.option("--force", is_flag=True, help="Overwrite OUT where it exists (never FILE).")
@scd_options
def command(
    file: str,
    output: str,
    key: Key,
    values: str,
    keep_code: bool,
    keep_others: bool,
    shift_time: bool,
    format_: str,
    force: bool,
    decoder: PayloadDecoder | None,
) -> int:
    """Write a capture that may be shown to others, and tell what it no longer holds.

    Addresses, TSAP texts, names, serial numbers, passwords and values become others of the same size; whatever is not
    understood becomes zeros. Sizes, times, pairing, error codes and what is asked for stay, so that an analysis finds the same.
    Checksums are right where they were. FILE is a pcap or pcapng file, also in gzip or zstd; it is read twice.
    """
    from dissect.anonymize.account import Account, Choices
    from dissect.anonymize.addresses import AddressMap
    from dissect.anonymize.rules import Rules
    from dissect.anonymize.scd import ScdRules, bindings_of
    from dissect.anonymize.survey import Survey
    from dissect.bindings.engine import ScdCarrier
    from dissect.engine.observer import Options
    from dissect.session import Run

    check_files((file,), output, force)
    choices = Choices(values, keep_code, keep_others, shift_time)
    account = Account()
    addresses = AddressMap(key)
    scd = decoder if isinstance(decoder, ScdCarrier) else None
    rules = Rules(key, addresses, choices, ScdRules(key, addresses, choices, scd, account))
    survey = Survey(key, rules, account, scd)
    run = Run((file,), survey, Options(decoder=scd))
    code = drive(run, (file,))
    if code == EXIT_INTERRUPTED:
        click.echo(f"s7dissect: interrupted, {name_of(output)} was not written", err=True)
        return code
    complain(run, code)
    survey.settle()
    _write(file, output, survey, addresses, choices, account, key.shift_ns if shift_time else 0)
    if scd is not None:
        account.bindings = bindings_of(scd.bindings, key, addresses)
    for kind, count in addresses.changed.items():
        if count:
            account.replaced[kind] = count
    lines = [json.dumps(account.as_dict(), indent=2)] if format_ == "json" else account.lines()
    if output == "-":
        click.echo("\n".join(lines), err=True)
    else:
        write(lines)
    return code


def _write(
    file: str, output: str, survey: Survey, addresses: AddressMap, choices: Choices, account: Account, shift_ns: int
) -> None:
    """Read the file again and write what becomes of it."""
    from dissect.anonymize.packet import Packets
    from dissect.anonymize.rewriter import Rewriter
    from dissect.source.files import open_capture

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
                "no packet of the capture is of S7 communication; nothing was written (--keep-others writes the others)."
            )
