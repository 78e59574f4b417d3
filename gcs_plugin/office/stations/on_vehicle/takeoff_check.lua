-- The check before take-off, on the vehicle itself: no telemetry link is needed. For ArduPilot: copy
-- it to APM/scripts of the vehicle's card and set SCR_ENABLE 1.
--
-- From arming to lift-off it compares the motors with each other, ten times a second: each turns,
-- none is late, at a common output none is too slow or too fast, and no two follow each other's
-- output. It counts the ESCs that report, and reads their temperatures and the battery. What it finds
-- it says to every ground station, as "DO NOT LIFT: motor 3 does not turn". It never touches the
-- flight.
--
-- Its limits and its sums are those of thrustmargin's own check (models/checks/takeoff.py). It needs
-- ESC telemetry; a motor without a speed is not spoken for. Yaw, leads and weight show in the first
-- seconds of hover, and an aircraft's own history is not on its card: they are left to the ground.

local DRIVEN, TURNING, FLOOR = 0.03, 30, 0.2  -- share of output; rpm; share of output
local LATE_S, ASKED_SHARE = 0.5, 0.5
local LEAST_POWER, MOST_POWER = 0.5, 1.5
local MEAN_S, LASTS_S, READINGS, LAG_S = 0.3, 0.3, 3, 0.5
local SLOW, FAST = 0.6, 1.25
local FEWEST_TO_EXCHANGE, EXCHANGE_EXPLAINS = 4, 0.25
local REST_S = 1.0
local HOT_ESC = 363.0  -- K

local EVERY_MS = 100
local KEPT = 12  -- looks: LAG_S and MEAN_S, with room
local CRITICAL, WARNING, INFO = 2, 4, 6  -- MAV_SEVERITY
local BATTERY = 0  -- battery monitor of the flight battery, from 0

-- Motor k is on the output with function 33 to 40, from the ninth on 82 to 85. From ArduPilot 4.5 on
-- its ESC has the number of that output.
local motors = {}
for k = 1, 12 do
  local purpose = k <= 8 and 32 + k or 73 + k
  local channel = SRV_Channels:find_channel(purpose)
  if channel then motors[#motors + 1] = { number = k, purpose = purpose, esc = channel } end
end

-- Pulse range of the outputs, us; DShot is scaled to 1000 to 2000.
local function range()
  local low, high = param:get("MOT_PWM_MIN") or 0, param:get("MOT_PWM_MAX") or 0
  if high > low and low > 0 then return low, high end
  return 1000, 2000
end

local run = nil  -- the run-up that goes on
local rest_volts, rest_s = nil, 0

local function said(text, severity)
  if not run.said[text] then
    run.said[text] = true
    if severity == CRITICAL then run.sound = false end
    gcs:send_text(severity, text)
  end
end

local function forbid(pattern, ...) said("DO NOT LIFT: " .. string.format(pattern, ...), CRITICAL) end

-- Median of a list, nil of fewer than two; the list is sorted.
local function median(list)
  if #list < 2 then return nil end
  table.sort(list)
  local half = #list // 2
  return #list % 2 == 1 and list[half + 1] or (list[half] + list[half + 1]) / 2
end

-- What each motor does now: rpm or nil, and output from 0 to 1 or nil.
local function look(now_s)
  local low, high = range()
  local seen = { s = now_s, rpm = {}, out = {} }
  for k, motor in ipairs(motors) do
    local rpm, pulse = esc_telem:get_rpm(motor.esc), SRV_Channels:get_output_pwm(motor.purpose)
    seen.rpm[k] = rpm and math.abs(rpm)
    if pulse and pulse > 0 then
      seen.out[k] = math.max(0, math.min(1, (pulse - low) / (high - low)))
    end
  end
  return seen
end

local function driven(seen)
  local turning = 0
  for k = 1, #motors do
    if (seen.out[k] or 0) > DRIVEN then return true end
    if (seen.rpm[k] or 0) >= TURNING then turning = turning + 1 end
  end
  return turning >= 2
end

local function turns(rpm) return rpm ~= nil and rpm >= TURNING end

-- A motor that stands while half of the others have turned for LATE_S, and is asked as they are.
local function starts(seen)
  local turning = 0
  for k = 1, #motors do
    local rpm = seen.rpm[k]
    if rpm and not run.heard[k] then
      run.heard[k] = true
      if turns(rpm) then run.before[k] = true end
    end
    if turns(rpm) and not run.first[k] then run.first[k] = seen.s end
    if turns(rpm) then turning = turning + 1 end
  end
  for k, motor in ipairs(motors) do
    local others, outputs = {}, {}
    for j = 1, #motors do
      if j ~= k and run.heard[j] then others[#others + 1] = run.first[j] or math.huge end
      if j ~= k and seen.out[j] then outputs[#outputs + 1] = seen.out[j] end
    end
    table.sort(others)
    local half_s = #others >= 2 and others[#others // 2 + 1] or math.huge
    local theirs, rpm = median(outputs), seen.rpm[k]
    local held = theirs and seen.out[k] and seen.out[k] < ASKED_SHARE * theirs
    if rpm and rpm < TURNING and not run.first[k] and not run.before[k] and turning >= 2
      and seen.s >= half_s + LATE_S - 1e-6 and not held then
      forbid("motor %d does not turn", motor.number)
    end
  end
end

-- Means of the last MEAN_S; nil of a motor of which one is unknown or, for the output, below FLOOR.
local function means(from)
  local rpm, out, count = {}, {}, 0
  for back = #run.kept, 1, -1 do
    local seen = run.kept[back]
    if seen.s < from - MEAN_S - 1e-6 then break end
    if seen.s <= from + 1e-6 then
      count = count + 1
      for k = 1, #motors do
        local r, o = seen.rpm[k], seen.out[k]
        if rpm[k] ~= false then rpm[k] = r and (rpm[k] or 0) + r or false end
        if out[k] ~= false then out[k] = o and o >= FLOOR and (out[k] or 0) + o or false end
      end
    end
  end
  for k = 1, #motors do
    rpm[k] = rpm[k] and rpm[k] / count or nil
    out[k] = out[k] and out[k] / count or nil
  end
  return rpm, out
end

-- Largest deviation of ln speed from a power of output that rotors have.
local function off_output(rpm, out)
  local x, y, mean_x, mean_y = {}, {}, 0, 0
  for k = 1, #motors do
    x[k], y[k] = math.log(out[k]), math.log(rpm[k])
    mean_x, mean_y = mean_x + x[k] / #motors, mean_y + y[k] / #motors
  end
  local xy, xx, most = 0, 1e-12, 0
  for k = 1, #motors do
    x[k], y[k] = x[k] - mean_x, y[k] - mean_y
    xy, xx = xy + x[k] * y[k], xx + x[k] * x[k]
  end
  local power = math.max(LEAST_POWER, math.min(MOST_POWER, xy / xx))
  for k = 1, #motors do most = math.max(most, math.abs(y[k] - power * x[k])) end
  return most
end

-- The motor whose speed must be swapped with that of motor k to match all outputs; nil for none.
local function exchanged_with(k, rpm, out)
  for j = 1, #motors do
    if not (rpm[j] and rpm[j] > 0 and out[j]) then return nil end
  end
  if #motors < FEWEST_TO_EXCHANGE then return nil end
  local best, least = nil, EXCHANGE_EXPLAINS * off_output(rpm, out)
  for j = 1, #motors do
    if j ~= k then
      rpm[k], rpm[j] = rpm[j], rpm[k]
      local left = off_output(rpm, out)
      if left < least then best, least = j, left end
      rpm[k], rpm[j] = rpm[j], rpm[k]
    end
  end
  return best
end

-- A motor slower or faster than the others at what its output allows beside theirs.
local function common_output(seen)
  local rpm, out = means(seen.s)
  for k, motor in ipairs(motors) do
    local speeds, outputs, all = {}, {}, out[k] ~= nil
    for j = 1, #motors do
      if j ~= k then
        if rpm[j] then speeds[#speeds + 1] = rpm[j] end
        if out[j] then outputs[#outputs + 1] = out[j] else all = false end
      end
    end
    local others, theirs = median(speeds), median(outputs)
    local known = all and rpm[k] and others and theirs and others >= TURNING
    local low, high, ratio = math.huge, 0, nil
    local asked = run.asked[k]
    if known then
      ratio = rpm[k] / others
      asked[#asked + 1] = { s = seen.s, share = out[k] / theirs }
    end
    while #asked > 0 and asked[1].s < seen.s - LAG_S - 1e-6 do table.remove(asked, 1) end
    for _, one in ipairs(asked) do
      low = math.min(low, one.share ^ LEAST_POWER, one.share ^ MOST_POWER)
      high = math.max(high, one.share ^ LEAST_POWER, one.share ^ MOST_POWER)
    end
    for name, wrong in pairs({
      ["slow for its output"] = known and ratio < SLOW * low,
      ["too fast: propeller?"] = known and ratio > FAST * high,
    }) do
      local since = run.wrong[k][name]
      if not wrong then
        run.wrong[k][name] = nil
      elseif not since then
        run.wrong[k][name] = { s = seen.s, count = 1 }
      else
        since.count = since.count + 1
        if since.count >= READINGS and seen.s - since.s >= LASTS_S - 1e-6 then
          local other = exchanged_with(k, rpm, out)
          if other then
            run.explained[k], run.explained[other] = true, true
            local a, b = motor.number, motors[other].number
            forbid("motors %d and %d are exchanged", math.min(a, b), math.max(a, b))
          elseif not run.explained[k] then
            forbid("motor %d %s", motor.number, name)
          end
        end
      end
    end
  end
end

-- ESCs that are too hot; and those that are silent while others report.
local function escs()
  local silent, reporting = {}, 0
  for k, motor in ipairs(motors) do
    local celsius = (esc_telem:get_temperature(motor.esc) or 0) / 100
    if celsius + 273.15 >= HOT_ESC then forbid("ESC %d has %.0f C", motor.number, celsius) end
    if run.heard[k] then reporting = reporting + 1 else silent[#silent + 1] = motor.number end
  end
  return silent, reporting
end

-- The end of a run-up: one line of what was well, and what is not known.
local function lifted()
  local silent, reporting = escs()
  if #silent > 0 then
    said("No speed of motors " .. table.concat(silent, " ") .. ": not checked", WARNING)
  end
  if not run.sound or reporting == 0 then return end
  local first, last = math.huge, 0
  for k = 1, #motors do
    if run.first[k] and not run.before[k] then
      first, last = math.min(first, run.first[k]), math.max(last, run.first[k])
    end
  end
  local apart = last > first and last - first or 0
  local sag = run.volts and run.least and string.format(", %.1fV to %.1fV", run.volts, run.least) or ""
  said(string.format("%d of %d turn within %.1fs%s", reporting, #motors, apart, sag), INFO)
end

local function begin(now_s)
  run = { kept = {}, heard = {}, before = {}, first = {}, asked = {}, wrong = {}, said = {}, explained = {},
          sound = true, volts = rest_volts, least = nil, begin_s = now_s, driven_s = now_s }
  for k = 1, #motors do run.asked[k], run.wrong[k] = {}, {} end
end

local flew = false

local function update()
  local now_s = tonumber(tostring(millis())) / 1000
  local flying, seen = vehicle:get_likely_flying(), look(now_s)
  local on = driven(seen)
  local volts = battery:healthy(BATTERY) and battery:voltage(BATTERY) or nil
  if not on then rest_volts = volts end
  if flying then
    if run and not flew then lifted() end
    run, flew = nil, true
    return update, EVERY_MS
  end
  -- A landing with motors on is no new start.
  if flew and on then return update, EVERY_MS end
  flew = false
  if not run then
    begin(now_s)
    run.idle = true
  end
  if on then run.idle, run.driven_s = false, now_s end
  if not on and not run.idle and now_s - run.driven_s >= REST_S then
    run = nil
    return update, EVERY_MS
  end
  run.kept[#run.kept + 1] = seen
  if #run.kept > KEPT then table.remove(run.kept, 1) end
  if volts and on then run.least = math.min(run.least or volts, volts) end
  if run.idle then
    run.volts = rest_volts
    for k = 1, #motors do
      if seen.rpm[k] then run.heard[k] = true end
    end
    return update, EVERY_MS
  end
  starts(seen)
  common_output(seen)
  escs()
  return update, EVERY_MS
end

if #motors < 2 then
  gcs:send_text(WARNING, "Take-off check: no motors by SERVOn_FUNCTION")
  return
end
return update()
