"""Convert signals to the rows of a FlightTrack, for logs and for live links."""
