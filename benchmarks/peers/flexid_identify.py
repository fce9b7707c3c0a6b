"""`flexid identify LOG` from the file, as one Python call without settings.

Noise, hold and starting values are not given, and the time includes reading the file.
"""

from benchmarks.peers.problem import COEFFICIENTS, Answer, Log
from flexid.identification.identify import identify as run
from flexid.recording.read import read_log


def identify(log: Log) -> Answer:
    # user code begins
    result = run([read_log(log.path)])
    # user code ends
    found = {name: result.coefficients[name] for name in COEFFICIENTS}
    return Answer(
        {name: estimate.value for name, estimate in found.items()},
        {name: estimate.interval for name, estimate in found.items()},
    )
