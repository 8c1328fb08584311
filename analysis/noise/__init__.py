"""Noise of a static log: models, Allan deviation, likelihood, the papers' recipes, planning.

U is the unit of the reading. tau is averaging time and T_c (``corr_time``) correlation time; the
comparison paper prints tau for T_c. To read the likelihood fit in order: spectrum, likelihood,
profile_likelihood, fit, inference, channel.
"""

from analysis.noise.allan import allan_deviation, fit_line
from analysis.noise.autocorrelation import correlogram
from analysis.noise.channel import characterise
from analysis.noise.fit import NoiseLikelihood
from analysis.noise.graph import loglog_slope, nearer_to_gaussian, white_noise
from analysis.noise.inference import infer
from analysis.noise.models import (
    UnifiedModel,
    adev_model,
    models_of_table_one,
    simulate_logs,
)
from analysis.noise.planner import Plan
from analysis.noise.position import cep, outliers, simulate_fixes
from analysis.noise.recipes import TerrainRecipe, five_coefficients, sigma_of_eq3
