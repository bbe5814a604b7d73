"""Options and messages of the commands that write a draft certificate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from accelcal.cli.common import UsageError, print_status, writable_file

if TYPE_CHECKING:
    from accelcal.calibration.export import Laboratory
    from accelcal.calibration.export.document import Draft

Dcc = Annotated[
    Path | None, typer.Option("--dcc", help="Write a draft certificate (DCC 3.2.1).", callback=writable_file)
]
Lab = Annotated[Path | None, typer.Option("--lab", help="TOML with the administrative data of --dcc.")]
Schema = Annotated[Path | None, typer.Option("--schema", help="Validate --dcc against this dcc.xsd.")]


def require_usable(dcc: Path | None, lab: Path | None, schema: Path | None) -> None:
    """Refuse options of a certificate without one, and a file of another kind.

    Raises
    ------
    UsageError
        With what was expected.
    """
    if dcc is None and (lab or schema):
        raise UsageError("--lab and --schema apply to a certificate; add --dcc draft.xml")
    if dcc is not None and dcc.suffix != ".xml":
        raise UsageError(f"--dcc {dcc}: expected a name that ends in .xml")


def laboratory_of(lab: Path | None) -> Laboratory:
    """The administrative data as far as they are declared."""
    from accelcal.calibration.export import Laboratory, read_laboratory

    return Laboratory() if lab is None else read_laboratory(lab)


def checked(certificate: Draft, schema: Path | None) -> Draft:
    """The certificate, validated where there is a schema."""
    from accelcal.calibration.export import require_valid

    if schema is not None:
        require_valid(certificate.text, schema)
    return certificate


def tell(path: Path, certificate: Draft, schema: Path | None) -> None:
    """Print what a written certificate lacks, and whether it was validated."""
    print_status(f"{path} is a draft; missing: {', '.join(certificate.missing) or 'nothing'}")
    valid = "not validated; give --schema dcc.xsd" if schema is None else f"valid against {schema}"
    print_status(f"{path} is {valid}")
