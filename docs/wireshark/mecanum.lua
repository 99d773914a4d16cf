-- Dissector for a mecanum car in Wireshark. `sim schema mecanum --format lua` prints it; do not edit.
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
    checked = false,
    fields_at = 2,
    id_at = 0,
  },
  messages = {
    {
      fields = { { name = "seq", offset = 0, size = 1, wire = "uint8", }, { name = "is_reset", offset = 1, size = 1, wire = "uint8", }, { name = "moving_idx", offset = 2, size = 1, values = { "forward", "rotate", "strafe", "left-front", "right-front", }, wire = "uint8", }, { name = "s", offset = 3, size = 2, unit = "1/10 rev", wire = "uint16", }, { name = "v", offset = 5, size = 2, unit = "1/10 r/min", wire = "int16", }, },
      id = 0,
      name = "motion",
      sender = "request",
      text = "Orders a motion, 控制指令.",
    },
    {
      fields = { { name = "seq", offset = 0, size = 1, wire = "uint8", }, { name = "axis_x", offset = 1, size = 2, unit = "1/10 rev", wire = "int16", }, { name = "axis_y", offset = 3, size = 2, unit = "1/10 rev", wire = "int16", }, { name = "ori", offset = 5, size = 2, unit = "1/10 deg", wire = "int16", }, },
      id = 1,
      name = "set_pose",
      sender = "request",
      text = "Says where the car is, 定义当前坐标.",
    },
    {
      fields = { { name = "seq", offset = 0, size = 1, wire = "uint8", }, { name = "mode", offset = 1, size = 1, values = { "board", "remote", }, wire = "uint8", }, },
      id = 2,
      name = "control_mode",
      sender = "request",
      text = "Says who drives, 切换控制模式.",
    },
    {
      fields = { { name = "seq", offset = 0, size = 1, wire = "uint8", }, { name = "v_x", offset = 1, size = 2, unit = "1/10 r/min", wire = "int16", }, { name = "v_y", offset = 3, size = 2, unit = "1/10 r/min", wire = "int16", }, { name = "axis_x", offset = 5, size = 2, unit = "1/10 rev", wire = "int16", }, { name = "axis_y", offset = 7, size = 2, unit = "1/10 rev", wire = "int16", }, { name = "ori", offset = 9, per = 10, size = 2, unit = "deg", wire = "int16", }, { name = "rfid", offset = 11, size = 4, wire = "uint32", }, { hex = true, name = "magn", offset = 15, size = 2, wire = "uint16", }, { name = "infra", offset = 17, size = 1, wire = "uint8", }, { count = 4, name = "ut_f", offset = 18, size = 2, unit = "mm", wire = "uint16", }, { count = 4, name = "ut_b", offset = 26, size = 2, unit = "mm", wire = "uint16", }, { bits = { "left", "right", }, name = "moto_state", offset = 34, size = 1, wire = "uint8", }, { name = "mile", offset = 35, size = 2, unit = "mm", wire = "uint16", }, },
      id = 0,
      name = "status",
      sender = "reply",
      text = "State of the car, 状态采集.",
    },
  },
  name = "mecanum",
  title = "mecanum (main)",
})

dissector({
  form = {
    lines = true,
  },
  messages = {
    {
      fields = { { name = "tenths", offset = 0, prefix = "X", size = 0, unit = "1/10 rev", wire = "int32", }, },
      id = 88,
      name = "X",
      sender = "request",
      text = "Forward.",
    },
    {
      fields = { { name = "tenths", offset = 0, prefix = "Y", size = 0, unit = "1/10 rev", wire = "int32", }, },
      id = 89,
      name = "Y",
      sender = "request",
      text = "Strafe, or rotate.",
    },
    {
      fields = { { name = "tenths", offset = 0, prefix = "Z", size = 0, unit = "1/10 rev", wire = "int32", }, },
      id = 90,
      name = "Z",
      sender = "request",
      text = "Rotate, or strafe.",
    },
    {
      fields = { { name = "tenths", offset = 0, prefix = "A", size = 0, unit = "1/10 rev", wire = "int32", }, },
      id = 65,
      name = "A",
      sender = "request",
      text = "To the left front.",
    },
    {
      fields = { { name = "tenths", offset = 0, prefix = "B", size = 0, unit = "1/10 rev", wire = "int32", }, },
      id = 66,
      name = "B",
      sender = "request",
      text = "To the right front.",
    },
    {
      fields = { { name = "speed", offset = 0, prefix = "V", size = 0, unit = "1/100 rev/s", wire = "int32", }, { name = "mileage", offset = 0, prefix = "S", size = 0, unit = "1/100 rev", wire = "int32", }, },
      id = 86,
      name = "report",
      sender = "reply",
      text = "Speed and mileage.",
    },
  },
  name = "mecanum_ros",
  title = "mecanum (ROS)",
})
