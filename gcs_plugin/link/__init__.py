"""Links: transports, the listener, signing, and what is sent."""
