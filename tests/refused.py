"""What a test asks in one line: that a call is refused, and that a raw log is here."""

import pytest

from sensorlogs import datasets


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
