"""Public names of flexid; the only list of them, which is also read at run time."""

from flexid.errors import AccelerationError as AccelerationError
from flexid.errors import ArgumentError as ArgumentError
from flexid.errors import CampaignError as CampaignError
from flexid.errors import ConvergenceError as ConvergenceError
from flexid.errors import ExperimentError as ExperimentError
from flexid.errors import FlexidError as FlexidError
from flexid.errors import ModelError as ModelError
from flexid.errors import RecordingError as RecordingError
from flexid.errors import SettingError as SettingError
from flexid.errors import SimulationError as SimulationError
from flexid.estimators.online import History as History
from flexid.estimators.online import OnlineEstimator as OnlineEstimator
from flexid.estimators.online import Status as Status
from flexid.estimators.recursive_least_squares import (
    recursive_least_squares as recursive_least_squares,
)
from flexid.estimators.samples import Samples as Samples
from flexid.identification.vocabulary.thresholds import Thresholds as Thresholds
from flexid.library.excitation import ExperimentDesign as ExperimentDesign
from flexid.library.excitation import LogExcitation as LogExcitation
from flexid.library.excitation import design as design
from flexid.library.excitation import excitation as excitation
from flexid.library.export import ExportedFiles as ExportedFiles
from flexid.library.export import derive as derive
from flexid.library.export import export as export
from flexid.library.identify import identify as identify
from flexid.library.identify import load as load
from flexid.library.joint_estimate import JointEstimate as JointEstimate
from flexid.library.logs import read_log as read_log
from flexid.library.logs import samples as samples
from flexid.library.simulate import CampaignResult as CampaignResult
from flexid.library.simulate import PaperReproduction as PaperReproduction
from flexid.library.simulate import SimulatedRun as SimulatedRun
from flexid.library.simulate import campaign as campaign
from flexid.library.simulate import reproduce as reproduce
from flexid.library.simulate import simulate as simulate
from flexid.library.validation import EstimateComparison as EstimateComparison
from flexid.library.validation import EstimateValidation as EstimateValidation
from flexid.library.validation import compare as compare
from flexid.library.validation import validate as validate
from flexid.library.watch import watch as watch
from flexid.library.watched import Watch as Watch
from flexid.models.flexible_joint import SHAPE_TERMS as SHAPE_TERMS
from flexid.models.flexible_joint import TERMS as TERMS
from flexid.models.flexible_joint import flexible_joint as flexible_joint
from flexid.models.flexible_joint import rigid_joint as rigid_joint
from flexid.models.model_file import read_model as read_model
from flexid.models.parametric_system import ParametricSystem as ParametricSystem
from flexid.models.parametric_system import Row as Row
from flexid.paper.parametric_observer import parametric_observer as parametric_observer
from flexid.recording.recording import Log as Log
from flexid.recording.recording import Recording as Recording
from flexid.stored_estimates.frequency_response import FrequencyResponse as FrequencyResponse
from flexid.streaming.health import Health as Health

__version__: str
