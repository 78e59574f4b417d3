"""The margin report: one self-contained HTML page, with JSON and CSV of the same numbers.

    FlightAnalysis + FlightLog --summary--> FlightReport --figures, render--> HTML, JSON, CSV

`summary` is the only place where a number is made; `figures`, `render` and the templates show it.
Plotly and the writers are imported only when something is written.
"""

from gcs_plugin.report.build import build_report as build_report
from gcs_plugin.report.data import SCHEMA as SCHEMA
from gcs_plugin.report.data import FlightReport as FlightReport
from gcs_plugin.report.data import Report as Report
from gcs_plugin.report.data import Unread as Unread
from gcs_plugin.report.summary import report_flight as report_flight
