"""What stands on an aircraft in the scene of a server that nobody looks at."""

import viser

from tests.gcs_plugin.view.view_flight import flight
from thrustmargin.gcs_plugin.view.scene.aircraft import VehicleNode
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow


def test_over_the_whole_field_only_bad_rotors_have_their_numbers():
    analysis = flight()
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        node = VehicleNode(server.scene, "/world", "1", analysis.model.airframe)
        row = ShownRow(analysis, 200)

        def numbered(faulty: frozenset[int]) -> list[int]:
            node.show(row, faulty)
            labels = (
                server.scene.get_handle_by_name(f"/world/vehicle_1/label_{k}") for k in "1234"
            )
            return [k for k, label in enumerate(labels, 1) if label is not None and label.visible]

        node.set_scale(1.0, detailed=True)
        assert numbered(frozenset()) == [1, 2, 3, 4]
        node.set_scale(1.0, detailed=False)
        assert numbered(frozenset({3})) == [3]
        assert numbered(frozenset()) == []
    finally:
        server.stop()
