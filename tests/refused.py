"""What tests ask in one line: a call is refused, a raw log is here, a log and a catalogue exist."""

import pytest

from sensorlogs import catalogue, datasets


def refused(kind, words, call, /, *given, **named):
    """Return the refusal of this kind that a call raises, in these words (a pattern, or None)."""
    with pytest.raises(kind, match=words) as caught:
        call(*given, **named)
    return caught.value


def where_here(call, /, *given, **named):
    """Return what a call gives, or skip the test where the raw log is not on this machine."""
    try:
        return call(*given, **named)
    except datasets.NotHere as error:
        pytest.skip(str(error))


def csv_of(folder, header, rows, name="my.csv", end="\n"):
    """Write a CSV of rows, each a line or its cells, and return its path; a header may lack."""
    lines = [row if isinstance(row, str) else ",".join(map(str, row)) for row in rows]
    path = folder / name
    path.write_text("\n".join([header, *lines] if header else lines) + end, encoding="utf-8")
    return path


def own_logs(monkeypatch, folder, text):
    """Write the reader's own catalogue of logs into a folder."""
    monkeypatch.setattr(catalogue, "OWN", folder / "logs.toml")
    catalogue.OWN.write_text(text, encoding="utf-8")
