-- What a thrust margin is made of, once a second, for slow links. For ArduPilot: copy it to
-- APM/scripts of the vehicle's card and set SCR_ENABLE 1.
--
-- Rotor speeds go out as the mean of a second, TM_RPM1 for the first ESC and so on, to every link:
-- 30 bytes each. thrustmargin monitor takes them where no ESC telemetry is heard. With TMS_PORT the
-- other messages that it needs are asked for once a second on that port: another 190 bytes.
-- An ESC that is silent is not spoken for. A peak shorter than a second is not seen.

-- TMS_PORT: telemetry port, 0 the first (USB); below 0 the rates stay as they are. Change KEY where
-- another script has the same.
local KEY = 181
assert(param:add_table(KEY, "TMS_", 1), "TMS_: change KEY")
assert(param:add_param(KEY, 1, "PORT", -1), "TMS_PORT")

local EVERY_MS, LOOKS = 100, 10  -- ms between two looks; looks of one mean
local ASK_AGAIN = 60  -- s, for ground stations set rates of their own
local ESCS = 12
-- ATTITUDE, GLOBAL_POSITION_INT, VFR_HUD, SCALED_PRESSURE, BATTERY_STATUS, SERVO_OUTPUT_RAW
local NEEDED = { 30, 33, 74, 29, 147, 36 }

local sum, count, looks, seconds = {}, {}, 0, 0

local function ask()
  local port = math.floor(param:get("TMS_PORT") or -1)
  if port < 0 then return end
  for _, id in ipairs(NEEDED) do gcs:set_message_interval(port, id, 1000000) end
end

local function send()
  -- The first rotor last: a row of the margin is made when it comes.
  for k = ESCS - 1, 0, -1 do
    if count[k] then gcs:send_named_float(string.format("TM_RPM%d", k + 1), sum[k] / count[k]) end
  end
  sum, count = {}, {}
end

local function update()
  if looks == 0 then
    if seconds % ASK_AGAIN == 0 then ask() end
    seconds = seconds + 1
  end
  for k = 0, ESCS - 1 do
    local rpm = esc_telem:get_rpm(k)
    if rpm then
      sum[k] = (sum[k] or 0) + rpm
      count[k] = (count[k] or 0) + 1
    end
  end
  looks = looks + 1
  if looks == LOOKS then
    send()
    looks = 0
  end
  return update, EVERY_MS
end

return update()
