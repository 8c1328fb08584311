"""Noise of a static log: models, Allan deviation, likelihood, the papers' recipes, planning.

U is the unit of the reading. tau is averaging time and T_c (``corr_time``) correlation time; the
comparison paper prints tau for T_c. To read the likelihood fit in order: spectrum, likelihood,
profile_likelihood, fit, inference, channel.
"""

from importlib import import_module

_FACE = {  # loaded when it is first asked for: `plan` needs one module of them
    "allan": ("allan_deviation", "fit_line"),
    "autocorrelation": ("correlogram",),
    "channel": ("characterise",),
    "fit": ("NoiseLikelihood",),
    "graph": ("loglog_slope", "nearer_to_gaussian", "white_noise"),
    "inference": ("infer",),
    "models": ("UnifiedModel", "adev_model", "models_of_table_one", "simulate_logs"),
    "planner": ("Plan",),
    "position": ("cep", "effective_samples", "outliers", "simulate_fixes"),
    "recipes": ("TerrainRecipe", "five_coefficients"),
}
_HOME = {name: module for module, names in _FACE.items() for name in names}
__all__ = list(_HOME)


def __getattr__(name):
    if name not in _HOME:
        raise AttributeError(f"analysis.noise has no '{name}'")
    return getattr(import_module(f"analysis.noise.{_HOME[name]}"), name)
