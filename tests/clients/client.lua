-- Drives, and sleeps by a child, since the language itself cannot; the port is opened again when it is gone.
local name = os.getenv("SIM_R150_PORT")
local motors = "\xaa\x55\x04\x12\x2c\x01\x2c\x01\x1e\xb4"

local function connect()
  local port
  repeat
    port = io.open(name, "r+b")
    if not port then os.execute("sleep 0.03") end
  until port
  os.execute("stty raw -echo 115200 <" .. name)
  port:setvbuf("no")
  return port
end

local port = connect()
for step = 1, 25 do
  if not port:write(motors) then
    port:close()
    port = connect()
    print("came back in step " .. step .. " at " .. os.time())
  end
  os.execute("sleep 0.1")
end
local pipe = io.popen("nproc")
print("processors " .. pipe:read("l"))
