"""Campaigns of shake-table trials, measured and simulated: their form, files, folds and import."""

from vsr2.campaign.campaign import (
    Campaign,
    CampaignTrial,
    MeasurementNoise,
    Specimen,
)
from vsr2.campaign.description import SCHEMA, campaign_schema
from vsr2.campaign.file_problems import CampaignProblem
from vsr2.campaign.folder import check_campaign, load_campaign
from vsr2.campaign.folds import grouped_folds, motion_folds, motion_resamples
from vsr2.campaign.intensity import TrialIntensities, intensity_measures
from vsr2.campaign.laboratory import import_lab
from vsr2.campaign.save import save_campaign
from vsr2.campaign.series import Series
from vsr2.campaign.simulate import RunOptions, simulate_campaign, trial_statuses
from vsr2.campaign.summary import campaign_summary
from vsr2.codes import TIERS, Tier

__all__ = [
    "SCHEMA",
    "TIERS",
    "Campaign",
    "CampaignProblem",
    "CampaignTrial",
    "MeasurementNoise",
    "RunOptions",
    "Series",
    "Specimen",
    "Tier",
    "TrialIntensities",
    "campaign_schema",
    "campaign_summary",
    "check_campaign",
    "grouped_folds",
    "import_lab",
    "intensity_measures",
    "load_campaign",
    "motion_folds",
    "motion_resamples",
    "save_campaign",
    "simulate_campaign",
    "trial_statuses",
]
