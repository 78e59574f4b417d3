"""Flight logs of every format as one FlightTrack: `read_log`."""

from gcs_plugin.logs.read import read_log as read_log
from gcs_plugin.logs.recording import ChannelReport as ChannelReport
from gcs_plugin.logs.recording import Damage as Damage
from gcs_plugin.logs.recording import FlightLog as FlightLog
from gcs_plugin.logs.recording import LogQuality as LogQuality
from gcs_plugin.logs.recording import Waypoint as Waypoint
