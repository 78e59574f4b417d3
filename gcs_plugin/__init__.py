"""The edge of thrustmargin: logs, links, screens, files, commands. Imports models and mission."""
