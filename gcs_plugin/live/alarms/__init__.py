"""What an alarm is, the rules, and those that stand."""
