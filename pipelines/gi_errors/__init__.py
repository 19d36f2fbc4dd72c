"""The errors of global illumination, always together: of the fit, of the solver, and of both."""

from pipelines.gi_errors.judge import Error, GiErrors, Judge, SetTruth
from pipelines.gi_errors.pixels import Pixels
from pipelines.gi_errors.truth import Engine, Truth, TruthSettings

__all__ = ["Engine", "Error", "GiErrors", "Judge", "Pixels", "SetTruth", "Truth", "TruthSettings"]
