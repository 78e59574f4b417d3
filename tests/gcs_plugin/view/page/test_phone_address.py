"""The address for a phone: of this computer where others can reach the page, and none invented."""

import socket

import pytest

from thrustmargin.gcs_plugin.view.page import view_page
from thrustmargin.gcs_plugin.view.page.view_page import network_address, scan_code


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.5", "::1", "localhost"])
def test_a_page_of_this_computer_alone_has_none(host: str):
    assert network_address(host) is None


def test_an_address_that_was_given_is_it():
    assert network_address("192.0.2.7") == "192.0.2.7"


class Probe:
    """A socket of a computer with one way out, or with none."""

    def __init__(self, own: str) -> None:
        self.own = own

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def connect(self, _: tuple[str, int]) -> None:
        if not self.own:
            raise OSError("Network is unreachable")

    def getsockname(self) -> tuple[str, int]:
        return self.own, 5000


@pytest.mark.parametrize(
    ("own", "found"), [("192.168.4.7", "192.168.4.7"), ("", None), ("127.0.0.1", None)]
)
@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_of_all_addresses_it_is_that_of_the_way_out(monkeypatch, host: str, own: str, found):
    monkeypatch.setattr(socket, "socket", lambda *_: Probe(own))
    assert view_page.network_address(host) == found


def test_the_code_is_a_drawing_of_black_on_white_that_grows_with_the_text():
    short, long = (
        scan_code("http://192.0.2.7:8080/"),
        scan_code("http://192.0.2.7:8080/" + 90 * "x"),
    )
    for code in (short, long):
        assert code.startswith("<svg")
        assert "viewBox" in code
        assert "#fff" in code
    assert len(long) > len(short)
