"""The margin report: one self-contained HTML page, with JSON and CSV of the same numbers.

    FlightAnalysis + FlightLog --summary--> JSON and rows --figures, render--> HTML, JSON, CSV

`summary` is the only place where a number is made; `figures`, `render` and the templates show it.
Plotly and the writers are imported only when something is written.
"""

from thrustmargin.gcs_plugin.reports.margin.data import SCHEMA as SCHEMA
from thrustmargin.gcs_plugin.reports.margin.data import Report as Report
from thrustmargin.gcs_plugin.reports.margin.data import ReportedFlight as ReportedFlight
from thrustmargin.gcs_plugin.reports.margin.summary import build_report as build_report
from thrustmargin.gcs_plugin.reports.margin.summary import report_flight as report_flight
