"""The search: sets of effects, scored on Gram matrices beside a discrepancy."""
