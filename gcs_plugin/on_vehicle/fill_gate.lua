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
-- It knows nothing of wind, of a worn propeller, nor of what hangs below. Texts are at most 42
-- characters, which is what the authorisation holds.

local REFUSE = {{ "true" if refuse else "false" }}  -- false: warn only
local PLANNED = {{ planned }}  -- kg, of the plan; used while TMG_FILL is below 0
local TANK = {{ tank }}  -- kg that the tank holds
local BATTERY = 0  -- battery monitor of the flight battery, from 0
local PRESSURE = {{ pressure }}  -- Pa that the table is made for

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
-- tank's gauge, from 0; below 0 there is none. Change KEY where another script has the same.
local KEY = 71
assert(param:add_table(KEY, "TMG_", 2), "TMG_: change KEY")
assert(param:add_param(KEY, 1, "FILL", -1), "TMG_FILL")
assert(param:add_param(KEY, 2, "GAUGE", -1), "TMG_GAUGE")

local EVERY_MS, REPEAT = 1000, 30  -- ms between two looks; looks after which a text is repeated
local WARNING, INFO = 4, 6  -- MAV_SEVERITY

local auth = REFUSE and arming:get_aux_auth_id() or nil
local said, rounds = nil, 0  -- the last text, and looks since
local was_armed, refusing = false, nil

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
  if not row then return nil, string.format("Air %.0fC beyond the fill table", celsius) end
  if not column then return nil, string.format("Battery %.1fV below the fill table", volts) end
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
  return PLANNED, "Planned"
end

-- Why it should not be armed, or nil; and what is well.
local function look()
  local kg, from = filled()
  if not kg then return from end
  if not battery:healthy(BATTERY) then return "Battery gives no reading" end
  local volts, pascal = battery:voltage(BATTERY), baro:get_pressure()
  local air = baro:get_external_temperature()
  if not (pascal > 20000) then return "Barometer gives no reading" end
  -- Thin air carries as hot air does: the temperature at the table's pressure.
  local celsius = (air + 273.15) * PRESSURE / pascal - 273.15
  local most, why = largest(celsius, volts)
  if not most then return why end
  local text = string.format("%s %.1fkg, most %.1f (%.0fC %.1fV)", from, kg, most, air, volts)
  if kg > most + 0.05 then return text end
  return nil, text
end

-- Why the vehicle would not heed a refusal, or nil.
local function unheard()
  if not auth then return "Fill gate: no authorisation is free" end
  local function bit(value, n) return math.floor(value / 2 ^ n) % 2 == 1 end
  local run, skipped = param:get("ARMING_CHECK"), param:get("ARMING_SKIPCHK")
  if run and not bit(run, 0) and not bit(run, 17) then return "Fill gate: ARMING_CHECK leaves it out" end
  if skipped and bit(skipped, 17) then return "Fill gate: ARMING_SKIPCHK leaves it out" end
end

local function say(severity, text)
  rounds = rounds + 1
  if text == said and rounds < REPEAT then return end
  if text then gcs:send_text(severity, text) end
  said, rounds = text, 0
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
  local well
  refusing, well = look()
  if auth and refusing then arming:set_aux_auth_failed(auth, refusing) end
  if auth and not refusing then arming:set_aux_auth_passed(auth) end
  local deaf = REFUSE and unheard()
  if deaf then
    say(WARNING, deaf)
  elseif refusing then
    say(WARNING, refusing)
  elseif said ~= well then
    say(INFO, well)
  end
  return update, EVERY_MS
end

return update()
