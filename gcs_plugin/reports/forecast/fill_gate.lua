-- Fill gate for ArduPilot. Written by thrustmargin {{ version }}; copy it to APM/scripts of the
-- vehicle's card and set SCR_ENABLE 1.
--
--   aircraft  {{ aircraft }}
--   model     {{ model }}
--   plan      {{ plan }}
--   limit     {{ limit }}
--
-- While disarmed it compares what is in the tank with the largest fill for the air and the battery
-- of that moment, and {{ "refuses" if refuse else "warns about" }} arming with more. It never touches the flight:
-- once armed it only says again what stood at arming. What it cannot read it does not guess: that
-- counts as a failure too.
--
-- Air temperature is TMG_AIR, else that of a thermometer outside the board, else the plan's. A board
-- is 10 to 20 K warmer than the air, so its own thermometer is never taken for the air.
--
-- It knows nothing of wind, of a worn propeller, nor of what hangs below. Texts are at most 42
-- characters, which is what the authorisation holds.

local REFUSE = {{ "true" if refuse else "false" }}  -- false: warn only
local PLANNED = {{ planned }}  -- kg, of the plan; used while TMG_FILL is below 0
local TANK = {{ tank }}  -- kg that the tank holds
local BATTERY = 0  -- battery monitor of the flight battery, from 0
local PRESSURE = {{ pressure }}  -- Pa that the table is made for
local AIR, AIR_FROM = {{ air }}, "{{ air_from }}"  -- degC: of the plan's day, or the default

-- Largest fill in kg: a row for each air temperature, a column for each voltage at rest.
-- The sag under load is in it{{ sag }}.
local CELSIUS = { {{ celsius }} }
local VOLTS = { {{ volts }} }
local FILL = {
{% for row in rows %}
  { {{ row }} },
{% endfor %}
}

-- TMG_FILL: kg that were filled in; below 0 the plan's. TMG_GAUGE: battery monitor that is the
-- tank's gauge, from 0; below 0 there is none. TMG_AIR: air temperature of the day in degC; below
-- -60 it is not stated. Change KEY where another script has the same.
local KEY = 180
assert(param:add_table(KEY, "TMG_", 3), "TMG_: change KEY")
assert(param:add_param(KEY, 1, "FILL", -1), "TMG_FILL")
assert(param:add_param(KEY, 2, "GAUGE", -1), "TMG_GAUGE")
assert(param:add_param(KEY, 3, "AIR", -100), "TMG_AIR")

local EVERY_MS, REPEAT = 1000, 30  -- ms between two looks; looks after which a text is repeated
local ALIKE = 3  -- looks in a row in which the air's temperature is the board's, so it is that one
local WARNING, INFO = 4, 6  -- MAV_SEVERITY

local auth = REFUSE and arming:get_aux_auth_id() or nil
local said, rounds = nil, 0  -- what the last text answered, and looks since
local was_armed, refusing = false, nil
local outside, alike = false, 0  -- whether a thermometer is outside, and looks since it showed it

-- Largest fill in kg, or nil and why it is not known. Between two rows the hotter counts, between
-- two columns the emptier battery.
local function largest(celsius, volts)
  local row, column
  for k = #CELSIUS, 1, -1 do
    if CELSIUS[k] >= celsius then row = k end
  end
  for k = 1, #VOLTS do
    if VOLTS[k] <= volts then column = k end
  end
  if not row then return nil, string.format("Air %.0fC beyond the fill table", celsius), "air" end
  if not column then
    return nil, string.format("Battery %.1fV below the fill table", volts), "battery"
  end
  return FILL[row][column]
end

-- kg in the tank and where that is from, or nil and why it is not known.
local function filled()
  local gauge = math.floor(param:get("TMG_GAUGE") or -1)
  if gauge >= 0 then
    local share = battery:healthy(gauge) and battery:capacity_remaining_pct(gauge)
    if not share then return nil, "Gauge gives no reading" end
    return TANK * share / 100, "Gauge"
  end
  local stated = param:get("TMG_FILL") or -1
  if stated >= 0 then return stated, "Stated" end
  return PLANNED, "Plan"
end

-- Air temperature in degC, and where it is from; empty of a thermometer outside. Without one
-- ArduPilot gives the board's, at most 35.
local function air_of_the_day()
  local stated = param:get("TMG_AIR") or -100
  local air, board = baro:get_external_temperature(), baro:get_temperature()
  alike = math.abs(air - math.min(board, 35)) < 0.01 and alike + 1 or 0
  if alike == 0 then outside = true end
  if alike >= ALIKE then outside = false end
  if stated >= -60 then return stated, " set" end
  if outside then return air, "" end
  return AIR, " " .. AIR_FROM
end

-- Why it should not be armed, or nil; what is well; and which of its answers that is.
local function look()
  local kg, from = filled()
  if not kg then return from, nil, from end
  if not battery:healthy(BATTERY) then return "Battery gives no reading", nil, "no battery" end
  local volts, pascal = battery:voltage(BATTERY), baro:get_pressure()
  local air, air_from = air_of_the_day()
  if not (pascal > 20000) then return "Barometer gives no reading", nil, "no pressure" end
  -- Thin air carries as hot air does: the temperature at the table's pressure.
  local celsius = (air + 273.15) * PRESSURE / pascal - 273.15
  local most, why, answer = largest(celsius, volts)
  if not most then return why, nil, answer end
  local text = string.format(
    "%s %.1fkg, most %.1f (%.0fC%s %.1fV)", from, kg, most, air, air_from, volts
  )
  -- A gauge trembles; what was stated does not.
  answer = from .. air_from .. (from == "Gauge" and "" or string.format(" %.1f", kg))
  if kg > most + 0.05 then return text, nil, "over " .. answer end
  return nil, text, answer
end

-- Why the vehicle would not heed a refusal, or nil.
local function unheard()
  if not auth then return "Fill gate: no authorisation is free" end
  local function bit(value, n) return math.floor(value / 2 ^ n) % 2 == 1 end
  local run, skipped = param:get("ARMING_CHECK"), param:get("ARMING_SKIPCHK")
  if run and not bit(run, 0) and not bit(run, 17) then return "Fill gate: ARMING_CHECK leaves it out" end
  if skipped and bit(skipped, 17) then return "Fill gate: ARMING_SKIPCHK leaves it out" end
end

-- A text goes out when the answer changes, not with each degree or volt in it.
local function say(severity, text, answer)
  rounds = rounds + 1
  if answer == said and rounds < REPEAT then return end
  gcs:send_text(severity, text)
  said, rounds = answer, 0
end

local function update()
  local armed = arming:is_armed()
  if armed then
    -- The tank empties and the voltage sags now: what stood at arming is said once more.
    if not was_armed and refusing then gcs:send_text(WARNING, refusing) end
    was_armed = true
    return update, EVERY_MS
  end
  was_armed = false
  local well, answer
  refusing, well, answer = look()
  if auth and refusing then arming:set_aux_auth_failed(auth, refusing) end
  if auth and not refusing then arming:set_aux_auth_passed(auth) end
  local deaf = REFUSE and unheard()
  if deaf then
    say(WARNING, deaf, deaf)
  elseif refusing then
    say(WARNING, refusing, answer)
  elseif said ~= answer then
    say(INFO, well, answer)
  end
  return update, EVERY_MS
end

return update()
