"""Logs of joints that MuJoCo simulates: `flexid.mujoco_log`."""

from flexid.exports import mujoco_log as worker
from flexid.library.entrance import entrance

mujoco_log = entrance(worker.mujoco_log)
