"""A MAVProxy module that watches another one from inside: `probe` prints what it saw as JSON.

Loaded before the MAVProxy module: the console's fields and colours, the threads that ran an
analysis, and what the module's import brought with it.
"""

import json
import sys
import threading

from MAVProxy.modules.lib import mp_module, textconsole


class Console(textconsole.SimpleConsole):
    def __init__(self):
        super().__init__()
        self.fields = {}

    def set_status(self, name, text="", row=0, fg="black", bg="white"):  # noqa: ARG002
        self.fields[name] = [text, fg, threading.current_thread().name]


class Probe(mp_module.MPModule):
    def __init__(self, mpstate):
        super().__init__(mpstate, __name__, "probe")
        mpstate.console = Console()
        self.analysed_on = set()
        self.add_command("probe", self.cmd_probe, "probe")
        self.add_command("spy", self.cmd_spy, "note which threads analyse")
        self.add_command("forget", self.cmd_forget, "what was shown so far")

    def cmd_forget(self, _):
        self.mpstate.console.fields.clear()
        print("forgotten")

    def cmd_spy(self, _):
        from thrustmargin.gcs_plugin.live.watch import vehicle_monitor as watch

        analyse = watch.analyse

        def noted(*given, **named):
            self.analysed_on.add(threading.current_thread().name)
            return analyse(*given, **named)

        watch.analyse = noted
        print("spying")

    def cmd_probe(self, _):
        seen = {
            "fields": self.mpstate.console.fields,
            "analysed_on": sorted(self.analysed_on),
            "threads": sorted(t.name for t in threading.enumerate()),
            "torch": "torch" in sys.modules,
        }
        print("PROBE" + json.dumps(seen))


def init(mpstate):
    return Probe(mpstate)
