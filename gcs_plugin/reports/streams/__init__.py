"""A flight as a file of messages for the viewers of robotics: MCAP, and a layout of Foxglove."""
