"""An ArduPilot vehicle as its Lua scripts see it: the few documented calls, in Lua 5.3.

Names, arguments and what comes back are those of ArduPilot's libraries/AP_Scripting/docs/docs.lua;
a call that is not here ends the script, as it does on a vehicle that lacks the binding.
"""

from __future__ import annotations

from typing import Any

from lupa.lua53 import LuaRuntime

BINDINGS = """
seen = { texts = {}, floats = {}, intervals = {}, auth = nil, ids = 1 }
now = { armed = false, temperature = 20, board = 33, pressure = 101325, rpm = {}, percent = {},
        volts = {}, healthy = {}, ms = 0, centidegrees = {}, channels = {}, pulses = {},
        flying = false }
params = {}
local function up_to(text, most) assert(#text <= most, "too long: " .. text); return text end
gcs = {}
function gcs:send_text(severity, text)
  seen.texts[#seen.texts + 1] = { severity, up_to(text, 50) }
end
function gcs:send_named_float(name, value)
  assert(type(value) == "number")
  seen.floats[#seen.floats + 1] = { up_to(name, 10), value }
end
function gcs:set_message_interval(port, id, us)
  seen.intervals[#seen.intervals + 1] = { port, id, us }
  return 0
end
arming = {}
function arming:is_armed() return now.armed end
function arming:get_aux_auth_id()
  if seen.ids == 0 then return nil end
  seen.ids = seen.ids - 1
  return 1
end
function arming:set_aux_auth_passed(id) assert(id == 1); seen.auth = "passed" end
function arming:set_aux_auth_failed(id, why) assert(id == 1); seen.auth = up_to(why, 42) end
battery = {}
function battery:healthy(k) return now.healthy[k] ~= false and now.volts[k] ~= nil end
function battery:voltage(k) return now.volts[k] or 0 end
function battery:capacity_remaining_pct(k) return now.percent[k] end
baro = {}
-- Without a thermometer outside it is the board's, at most 35.
function baro:get_external_temperature() return now.temperature or math.min(now.board, 35) end
function baro:get_temperature() return now.board end
function baro:get_pressure() return now.pressure end
esc_telem = {}
function esc_telem:get_rpm(k) return now.rpm[k] end
function esc_telem:get_temperature(k) return now.centidegrees[k] end
SRV_Channels = {}
function SRV_Channels:find_channel(purpose) return now.channels[purpose] end
function SRV_Channels:get_output_pwm(purpose) return now.pulses[purpose] end
vehicle = {}
function vehicle:get_likely_flying() return now.flying end
param = {}
function param:get(name) return params[name] end
function param:add_table(key, prefix, count) table_prefix = prefix; return key < 200 end
function param:add_param(key, number, name, value)
  params[table_prefix .. name] = params[table_prefix .. name] or value
  return true
end
function millis() return now.ms end
os, io, require, package, debug = nil, nil, nil, nil, nil
"""


class ScriptedVehicle:
    """Runs one script; `now` and `params` are what it may read, set as attributes and items."""

    def __init__(self, **params: float) -> None:
        self._lua: Any = LuaRuntime(unpack_returned_tuples=True)
        self._lua.execute(BINDINGS)
        self.now, self.params = self._lua.globals().now, self._lua.globals().params
        for name, value in params.items():
            self.params[name] = value
        self._next: Any = None
        self.every_ms = 0

    def load(self, script: str) -> None:
        """Start the script, whose first look is now."""
        self._next, self.every_ms = self._lua.execute(script)

    def look(self, times: int = 1) -> None:
        """The scheduler calls it again, so many times."""
        for _ in range(times):
            self.now.ms += self.every_ms
            self._next, self.every_ms = self._next()

    @property
    def auth(self) -> str | None:
        """`passed`, or why arming is refused."""
        return self._lua.globals().seen.auth

    def no_authorisation_left(self) -> None:
        self._lua.globals().seen.ids = 0

    def taken(self, kind: str) -> list[tuple[Any, ...]]:
        """What was sent since it was last asked: `texts`, `floats` or `intervals`."""
        seen = self._lua.globals().seen
        rows = [tuple(row.values()) for row in seen[kind].values()]
        seen[kind] = self._lua.table()
        return rows
