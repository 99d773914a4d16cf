-- Dissector for an R150 in Wireshark. `sim schema r150 --format lua` prints it; do not edit.
-- Copy it into Wireshark's folder of personal Lua plugins, or start `wireshark -X lua_script:FILE`.
-- It decodes what `sim trace T.jsonl --to FILE.pcapng` writes.

local bxor = (bit32 or bit).bxor

-- CRC-16/IBM-SDLC.
local function crc(bytes)
  local sum = 0xFFFF
  for i = 0, bytes:len() - 1 do
    sum = bxor(sum, bytes:get_index(i))
    for _ = 1, 8 do
      local low = sum % 2
      sum = math.floor(sum / 2)
      if low == 1 then sum = bxor(sum, 0x8408) end
    end
  end
  return 0xFFFF - sum
end

-- A field of a protocol as Wireshark knows it.
local function declared(all, abbreviation, field)
  local made
  if field.per then
    made = ProtoField.double(abbreviation, field.name)
  elseif field.wire == "bool" then
    made = ProtoField.bool(abbreviation, field.name)
  else
    local values
    if field.values then
      values = {}
      for i, word in ipairs(field.values) do values[i - 1] = word end
    end
    made = ProtoField[field.wire](abbreviation, field.name, field.hex and base.HEX or base.DEC, values)
  end
  all[#all + 1] = made
  for i, word in ipairs(field.bits or {}) do
    local name = abbreviation .. "." .. word:gsub("[^%w]", "_")
    local mask = math.floor(2 ^ (i - 1))
    field.flags = field.flags or {}
    field.flags[i] = ProtoField.bool(name, word, field.size * 8, nil, mask)
    all[#all + 1] = field.flags[i]
  end
  return made
end

local function number(field, range, big)
  local signed = field.wire:sub(1, 3) == "int"
  if big then return signed and range:int() or range:uint() end
  return signed and range:le_int() or range:le_uint()
end

local function show(tree, field, range, value)
  local item = tree:add(field.made, range, field.wire == "bool" and value ~= 0 or value / (field.per or 1))
  if field.unit then item:append_text(" " .. field.unit) end
  for _, flag in ipairs(field.flags or {}) do item:add(flag, range, value) end
end

-- Fields of a message of bytes.
local function show_bytes(tree, message, range, big)
  for _, field in ipairs(message.fields) do
    for i = 0, (field.count or 1) - 1 do
      local from = field.offset + i * field.size
      if from + field.size > range:len() then return end
      local part = range(from, field.size)
      show(tree, field, part, number(field, part, big))
    end
  end
end

-- Fields of a line: letters and a number each.
local function show_words(tree, message, range)
  local text, from = range:string(), 1
  for _, field in ipairs(message.fields) do
    local first, last, digits = text:find(field.prefix .. "([+-]?%d+)", from)
    if not first then return end
    show(tree, field, range(first - 1, last - first + 1), tonumber(digits))
    from = last + 1
  end
end

local function dissector(link)
  local proto = Proto(link.name, link.title)
  local form, all, messages = link.form, {}, { request = {}, reply = {} }
  local id_field = ProtoField.uint8(link.name .. ".id", "identity", base.HEX)
  local message_field = ProtoField.string(link.name .. ".message", "message")
  all[1], all[2] = id_field, message_field
  for _, message in ipairs(link.messages) do
    messages[message.sender][message.id] = message
    for _, field in ipairs(message.fields) do
      local path = { link.name, message.sender, message.name, field.name }
      field.made = declared(all, table.concat(path, "."), field)
    end
  end
  proto.fields = all
  local wrong = ProtoExpert.new(link.name .. ".crc_wrong", "The CRC is wrong", expert.group.CHECKSUM, expert.severity.WARN)
  local unknown = ProtoExpert.new(link.name .. ".unknown", "No such message", expert.group.UNDECODED, expert.severity.WARN)
  proto.experts = { wrong, unknown }
  if not form.lines then proto.prefs.big = Pref.bool("Big-endian", false, "Order of the bytes in a field") end

  function proto.dissector(buffer, pinfo, tree)
    local sender = pinfo.p2p_dir == 1 and "reply" or "request"
    local id_at = form.id_at or 0
    local length = buffer:len()
    if length <= id_at then return 0 end
    local id = buffer(id_at, 1):uint()
    local message = messages[sender][id]
    pinfo.cols.protocol = link.title
    local summary = sender .. " " .. (message and message.name or string.format("0x%02X", id))
    pinfo.cols.info = summary
    local root = tree:add(proto, buffer())
    root:append_text(": " .. summary)
    root:add(id_field, buffer(id_at, 1))
    if message then
      root:add(message_field, buffer(id_at, 1), message.name):append_text(": " .. message.text)
    else
      root:add_proto_expert_info(unknown)
    end
    local tail = form.checked and 2 or 0
    if form.checked and length >= id_at + 3 then
      local right = crc(buffer(id_at, length - 2 - id_at):bytes())
      if buffer(length - 2, 2):le_uint() ~= right then
        root:add_proto_expert_info(wrong, string.format("The CRC is wrong: 0x%04X is right", right))
        pinfo.cols.info = summary .. " [CRC is wrong]"
      end
    end
    if not message then return length end
    if form.lines then
      show_words(root, message, buffer())
    elseif length > form.fields_at + tail then
      show_bytes(root, message, buffer(form.fields_at, length - form.fields_at - tail), proto.prefs.big)
    end
    return length
  end
end

dissector({
  form = {
    checked = true,
    fields_at = 4,
    id_at = 3,
  },
  messages = {
    {
      fields = { { bits = { "12v-a", "12v-b", "12v-c", "12v-d", "48v", "5v", }, name = "on", offset = 0, size = 4, wire = "uint32", }, },
      id = 2,
      name = "power_control",
      sender = "request",
      text = "Switches these rails on and the others off, 电源控制 (4.3.1).",
    },
    {
      fields = { { count = 4, name = "duty", offset = 0, size = 2, unit = "0.1 %", wire = "uint16", }, },
      id = 3,
      name = "set_pwm_outputs",
      sender = "request",
      text = "Sets the four PWM outputs, 四路 PWM 输出控制 (4.3.2).",
    },
    {
      fields = { },
      id = 4,
      name = "get_pwm_outputs",
      sender = "request",
      text = "Asks for the duty of the four PWM outputs (4.3.3).",
    },
    {
      fields = { },
      id = 5,
      name = "get_pwm_inputs",
      sender = "request",
      text = "Asks for the four PWM inputs (4.3.4).",
    },
    {
      fields = { },
      id = 6,
      name = "system_info",
      sender = "request",
      text = "Asks for system info, 系统信息 (4.3.5).",
    },
    {
      fields = { },
      id = 7,
      name = "heartbeat",
      sender = "request",
      text = "Says that the client is there, 心跳包 (4.3.6).",
    },
    {
      fields = { },
      id = 240,
      name = "version",
      sender = "request",
      text = "Asks for the versions, 版本号 (4.3.7).",
    },
    {
      fields = { { name = "right", offset = 0, size = 2, unit = "0.1 %", wire = "int16", }, { name = "left", offset = 2, size = 2, unit = "0.1 %", wire = "int16", }, },
      id = 18,
      name = "set_motors",
      sender = "request",
      text = "Sets the motors' PWM, positive forward, 设置电机 PWM (4.3.8).",
    },
    {
      fields = { { name = "success", offset = 0, size = 1, wire = "bool", }, },
      id = 2,
      name = "power_control",
      sender = "reply",
      text = "Success or failure of a command.",
    },
    {
      fields = { { name = "success", offset = 0, size = 1, wire = "bool", }, },
      id = 3,
      name = "set_pwm_outputs",
      sender = "reply",
      text = "Success or failure of a command.",
    },
    {
      fields = { { count = 4, name = "duty", offset = 0, size = 2, unit = "0.1 %", wire = "uint16", }, },
      id = 4,
      name = "get_pwm_outputs",
      sender = "reply",
      text = "Duty of the four PWM outputs (4.3.3).",
    },
    {
      fields = { { count = 4, name = "frequency_hz", offset = 0, size = 4, unit = "Hz", wire = "uint32", }, { count = 4, name = "duty", offset = 16, size = 2, unit = "0.1 %", wire = "uint16", }, },
      id = 5,
      name = "get_pwm_inputs",
      sender = "reply",
      text = "The four PWM inputs (4.3.4).",
    },
    {
      fields = { { count = 4, name = "voltage_12v", offset = 0, per = 1000, size = 4, unit = "V", wire = "uint32", }, { name = "voltage_48v", offset = 16, per = 1000, size = 4, unit = "V", wire = "uint32", }, { count = 4, name = "current_12v", offset = 20, per = 1000, size = 4, unit = "A", wire = "int32", }, { name = "current_48v", offset = 36, per = 1000, size = 4, unit = "A", wire = "int32", }, { count = 2, name = "temp_12v", offset = 40, per = 10, size = 4, unit = "degC", wire = "int32", }, { bits = { "overcurrent_ab", "overcurrent_cd", "overcurrent_48v", "overcurrent_5v", "over_temperature_ab", "over_temperature_cd", "power_module_fault", }, name = "sys_status", offset = 48, size = 4, wire = "uint32", }, { name = "power_ctrl_mode", offset = 52, size = 1, values = { "rs232", "app", }, wire = "uint8", }, { name = "pwm_ctrl_mode", offset = 53, size = 1, values = { "rs232", "app", }, wire = "uint8", }, { bits = { "12v-a", "12v-b", "12v-c", "12v-d", "48v", "5v", }, name = "power_status", offset = 54, size = 1, wire = "uint8", }, { bits = { "a", "b", "c", "d", }, name = "pwm_status", offset = 55, size = 1, wire = "uint8", }, },
      id = 6,
      name = "system_info",
      sender = "reply",
      text = "Supplies, rails, errors and modes (4.3.5).",
    },
    {
      fields = { { name = "success", offset = 0, size = 1, wire = "bool", }, },
      id = 7,
      name = "heartbeat",
      sender = "reply",
      text = "Success or failure of a command.",
    },
    {
      fields = { { hex = true, name = "hardware", offset = 0, size = 4, wire = "uint32", }, { hex = true, name = "software", offset = 4, size = 4, wire = "uint32", }, },
      id = 240,
      name = "version",
      sender = "reply",
      text = "Versions (4.3.7); the most significant byte is the major one.",
    },
    {
      fields = { { name = "right_rpm", offset = 0, size = 2, unit = "r/min", wire = "int16", }, { name = "left_rpm", offset = 2, size = 2, unit = "r/min", wire = "int16", }, { name = "soc", offset = 4, per = 10, size = 2, unit = "%", wire = "uint16", }, },
      id = 18,
      name = "set_motors",
      sender = "reply",
      text = "Speeds of the motors' shafts, and the charge (4.3.8).",
    },
  },
  name = "r150",
  title = "r150 (RS-232)",
})
