"""From the frames of one vehicle to rows of channels."""
