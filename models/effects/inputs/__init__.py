"""Effects on what was reported: what airspeed, tank and delays really were."""
