"""A certificate held against the DCC schema that the user has; nothing is ever fetched."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

from accelcal._support.errors import AccelcalError, MissingExtra

MOST_ERRORS = 3
"""Errors that are spelled out."""


class SchemaError(AccelcalError):
    """A certificate does not follow the schema, or the schema cannot be read. The text states where."""


def require_valid(text: str, schema: Path) -> None:
    """Check a certificate against a local schema.

    Parameters
    ----------
    text : the certificate.
    schema : dcc.xsd; what it imports (SI_Format.xsd, xmldsig-core-schema.xsd) is read from the same folder.

    Raises
    ------
    MissingExtra
        If xmlschema is not installed.
    SchemaError
        If the schema is not usable, or the certificate does not follow it.
    """
    try:
        import xmlschema
    except ImportError as error:
        raise MissingExtra('--schema needs xmlschema; install it with: pip install "accelcal[dcc]"') from error
    if not schema.is_file():
        raise SchemaError(f"{schema}: there is no such file; get dcc.xsd from https://ptb.de/dcc, version 3.2.1")

    def beside(address: str) -> str:
        """An imported schema is the file of its name in the same folder."""
        return str(schema.parent.absolute() / Path(urlsplit(address).path).name)

    try:
        rules = xmlschema.XMLSchema(str(schema.absolute()), uri_mapper=beside, allow="local")
    except (xmlschema.XMLSchemaException, OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:300]
        raise SchemaError(
            f"{schema}: cannot be used as a schema ({reason}); put what it imports, SI_Format.xsd and "
            "xmldsig-core-schema.xsd, beside it"
        ) from None
    errors = [f"{error.path}: {error.reason}" for error in rules.iter_errors(text)]
    if errors:
        more = f" and {len(errors) - MOST_ERRORS} more" if len(errors) > MOST_ERRORS else ""
        raise SchemaError(f"the certificate does not follow {schema}: {'; '.join(errors[:MOST_ERRORS])}{more}")
