"""What scenes predict of a campaign: the probability that each trial overturns."""

from vsr2.prediction.prediction import Prediction, predict

__all__ = ["Prediction", "predict"]
