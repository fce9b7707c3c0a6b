"""Many runs of an experiment: planned, run here or on a cluster, kept, resumed and summarised."""

from flexid.campaigns.runner import run_campaign
from flexid.campaigns.summary import Summary, summarise

__all__ = ["Summary", "run_campaign", "summarise"]
