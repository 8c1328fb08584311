"""The words of a comparison: a rule gives a code and what it is about, notes.toml the sentence."""

from analysis.noise.notes import of_room

_, said = of_room(__name__)
