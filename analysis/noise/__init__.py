"""Noise of a static log: models, Allan deviation, autocorrelation and what can be read off them."""
