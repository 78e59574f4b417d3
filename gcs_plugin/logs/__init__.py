"""Read flight logs of every format as one FlightTrack: `read_log`."""

from thrustmargin.gcs_plugin.logs.read import read_log as read_log
from thrustmargin.gcs_plugin.logs.read import read_sorties as read_sorties
from thrustmargin.gcs_plugin.telemetry.recording import ChannelReport as ChannelReport
from thrustmargin.gcs_plugin.telemetry.recording import Damage as Damage
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog as FlightLog
from thrustmargin.gcs_plugin.telemetry.recording import LogQuality as LogQuality
