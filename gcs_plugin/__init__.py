"""The edge of thrustmargin: logs, links, screens, files and commands. Imports models and mission."""
