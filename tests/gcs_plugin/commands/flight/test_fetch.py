"""What `fetch` is asked for on its command line; what it fetches is tested with real links."""

import tyro

from thrustmargin.gcs_plugin.commands.flight.fetch import FetchLog, FetchMission


def test_a_mission_goes_to_a_file_of_a_plain_name():
    assert tyro.cli(FetchMission, args=["udpin:127.0.0.1:14550"]).output.name == "mission.plan"


def test_both_orders_take_the_same_options_of_the_link():
    link = ["/dev/ttyUSB0,57600", "--vehicle", "7", "--timeout", "3"]
    for order in (FetchMission, FetchLog):
        made = tyro.cli(order, args=link)
        assert (made.url, made.vehicle, made.timeout) == ("/dev/ttyUSB0,57600", 7, 3.0)
