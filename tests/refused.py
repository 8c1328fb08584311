"""What must be refused, in one line of a test."""

import pytest


def refused(kind, words, call, /, *given, **named):
    """Return the refusal of this kind that a call raises, in these words (a pattern, or None)."""
    with pytest.raises(kind, match=words) as caught:
        call(*given, **named)
    return caught.value
