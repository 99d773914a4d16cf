"""Each call, as it is meant."""

import json
import tomllib

from simulator import call, ask, step, until, Events, HEARTBEAT

state = call("GET", "/v1/state")
assert state["seed"] == 1 and state["time"] == "real" and not state["paused"], state
(device,) = state["devices"]
assert device["kind"] == "r150" and len(device["wheels"]) == 4 and device["report"] == [], device

# Names, and values of names.
names = {one["name"]: one for one in call("GET", "/v1/names")["names"]}
assert names["truth.speed_mps"]["unit"] == "m/s" and names["truth.speed_mps"]["meaning"], names
values = call("GET", "/v1/names?names=truth.speed_mps,truth.at_rest")["values"]
assert values == {"truth.speed_mps": 0.0, "truth.at_rest": values["truth.at_rest"]}, values
why = call("GET", "/v1/names?names=truth.sped_mps", status=422)["error"]
assert "did you mean `truth.speed_mps`" in why, why

# The forms: a step, with each fault, and which device can have it.
schema = call("GET", "/v1/schema")
assert "$defs" in schema["step"] and schema["time"]["oneOf"], schema.keys()
assert "unlock" in schema["operators"]["r150"] and "unlock" not in schema["operators"]["mecanum"]
assert any(fault["kind"] == "rail-short" for fault in schema["faults"])
# The form of steps for each kind of device has what it takes, and nothing that it refuses.
words = {kind: json.dumps(form) for kind, form in schema["steps"].items()}
for word in ["strafe-left", "left-front", '"ros"']:
    assert word in words["mecanum"] and word not in words["r150"], word
# The beginning of a scenario file with the same devices.
assert [device["name"] for device in tomllib.loads(schema["file"])["device"]] == ["r150"], schema["file"]

# What happens is reported as it happens; each line only to the streams that want it.
events = Events("?names=truth.at_rest&rate=20&picture=20&traffic=true")
assert "truth.at_rest" in events.wait("values")["values"]
assert len(events.wait("picture")["devices"]) == 1
assert ask(HEARTBEAT, 7)
assert events.wait("log", lambda log: log["role"] == "request")["line"].count("heartbeat") == 1
events.wait("log", lambda log: log["role"] == "reply")

# These were for a reader that reads. Events from here on wait until they are looked for.
events = Events()

# A fault is there until it is cleared, by its name or with all others.
fault = step({"fault": {"kind": "mute", "direction": "to-client"}})
assert fault["state"] == "active" and fault["name"] == "mute" and fault["added"], fault
assert [fault[key] for key in ["device", "key", "what"]] == ["r150", "fault", "mute"], fault
assert fault["t"] == fault["begun_s"], fault
events.wait("log", lambda log: log["code"] == "fault_armed")
assert call("GET", "/v1/steps/mute")["state"] == "active"
assert call("DELETE", "/v1/steps/mute")["state"] == "done"
events.wait("log", lambda log: log["code"] == "fault_cleared")
events.wait("step", lambda one: one["name"] == "mute" and one["state"] == "done")
# Each stream has a step behind the log of its consequences.
second = Events()
for number in range(200):
    name = f"round-{number}"
    step({"name": name, "fault": {"kind": "mute", "direction": "to-client"}})
    call("DELETE", f"/v1/steps/{name}")
    for one in (events, second):
        one.wait("log", lambda log: log["code"] == "fault_cleared")
        one.wait("step", lambda step: step["name"] == name and step["state"] == "done")
step({"name": "a b/c", "fault": {"kind": "bit-flips", "probability": 0.01}})
assert call("DELETE", "/v1/steps/a%20b%2Fc")["name"] == "a b/c"
step({"fault": {"kind": "mute", "direction": "to-client"}, "for": "10 ms"})
step({"fault": {"kind": "mute", "direction": "to-device"}})
before = call("GET", "/v1/state")["t"]
cleared = call("DELETE", "/v1/steps")
assert cleared["cleared"][-1] == "mute 3" and before <= cleared["t"] <= call("GET", "/v1/state")["t"], cleared
assert all(one["state"] == "done" for one in call("GET", "/v1/steps")["steps"])

# The operator and the world, which are undone in the same way.
stop = step({"operator": {"emergency_stop": True}})
assert (stop["key"], stop["what"]) == ("operator", "emergency_stop"), stop
assert call("DELETE", f"/v1/steps/{stop['name'].replace(' ', '%20')}")["state"] == "done"
box = {"box": [{"name": "crate", "at_m": [3, 0], "length": "0.3 m", "width": "1 m"}]}
added = step({"world": {"add": box}})
assert len(call("GET", "/v1/state")["world"]["obstacles"]) == 1
call("DELETE", f"/v1/steps/{added['name'].replace(' ', '%20')}")
assert call("GET", "/v1/state")["world"]["obstacles"] == []

# Conditions are waited for in simulated time.
call("POST", "/v1/time", "\"pause\"")
step({"fault": {"kind": "push", "ahead": "3000 N"}, "for": "500 ms"})
moves = step({"name": "it moves", "expect": {"that": "truth.speed_mps > 0.05", "within": "60 s"}})
assert moves["state"] == "active", moves
call("POST", "/v1/time", "\"resume\"")
events.wait("step", lambda one: one["name"] == "it moves" and one["state"] == "done")
until("truth.at_rest")
late = step({"expect": {"that": "truth.speed_mps > 9", "within": "50 ms"}}, wait=True)
assert late["state"] == "failed" and "truth.speed_mps = 0" in late["why"], late
assert (late["key"], late["what"]) == ("expect", "truth.speed_mps > 9"), late
# A failure is reported when it is found, and stays known.
failure = events.wait("failure")
assert failure["what"] == late["why"] and late["begun_s"] < failure["t"] <= late["t"], (failure, late)
assert call("GET", "/v1/state")["failures"] == [failure], failure

# Time stands still, goes on by so much, faster, and on.
paused = call("POST", "/v1/time", "\"pause\"")
assert paused["paused"], paused
again = call("GET", "/v1/state")
assert again["paused"] and again["t"] == paused["t"], (paused, again)
stepped = call("POST", "/v1/time", {"step": "250 ms"})
assert stepped["paused"] and abs(stepped["t"] - paused["t"] - 0.25) < 1e-9, (paused, stepped)
assert events.wait("time", lambda time: time["t"] == stepped["t"])["paused"]
assert call("POST", "/v1/time", {"speed": 20})["speed"] == 20
assert not call("POST", "/v1/time", "\"resume\"")["paused"]
until("t > %f" % (stepped["t"] + 20))
call("POST", "/v1/time", {"speed": 1})

# What a client believes is a name from then on.
assert call("POST", "/v1/published", {"x": 1.5, "y": -2}) == {"published": {"x": 1.5, "y": -2}}
assert call("GET", "/v1/names?names=client.x,client.y")["values"] == {"client.x": 1.5, "client.y": -2.0}
until("client.x > 1 && truth.x_m < 100")
for values in [{}, [], 7, {"x": "1"}, {"attached": 1}, {"X": 1}, {"x" * 300: 1}]:
    assert call("POST", "/v1/published", values, status=422)["error"], values
    events.wait("log", lambda log: log["code"] == "bad_publication")
assert call("POST", "/v1/published", {"x": None}, status=400)["error"]

# What makes no sense is refused in words, and changes nothing.
for body, words in [
    ({"fault": {"kind": "bit-flipz"}}, "bit-flips"),
    ({"fault": {"kind": "bit-flips", "probability": 2}}, "probability"),
    ({"fault": {"kind": "mute", "direction": "to-client"}, "device": "car"}, "car"),
    ({"expect": {"that": "truth.sped_mps > 1"}}, "did you mean"),
    ({"expect": {"that": "(" * 3000}}, "2000 bytes"),
    ({"expect": {"that": "(" * 1900}}, "expect.that"),
    ({"host": {"send": "version"}}, "scripted"),
    ({"what": 1}, "what"),
    ({}, "step"),
    ([], "object"),
    ("7", "object"),
]:
    why = step(body, status=422)["error"]
    assert words in why and len(why) < 3000, (body, why)
assert "null" in step({"operator": None}, status=400)["error"]
for change in ['"stop"', "{}", '{"speed": 0}', '{"speed": 1e9}', '{"speed": "1"}', '{"step": 5}', '{"step": "-1 s"}']:
    call("POST", "/v1/time", change, status=422)
call("DELETE", "/v1/steps/none", status=404)
call("GET", "/v1/events?names=nope", status=422)
