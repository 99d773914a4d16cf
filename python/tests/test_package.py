"""The installed package and its plugin, as users have them."""

import json
import os
import subprocess
import sys
import textwrap
import time

import pytest
import rigsim

pytest_plugins = ["pytester"]
HEARTBEAT = bytes.fromhex("AA 55 00 07 C7 84")
STAND = 'schema = 1\ntitle = "Stand"\ngood_client = "Any."\nlimit = "%s"\ndevice = [{ kind = "r150" }]\n'


def ask(port):
    """A heartbeat is answered."""
    file = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(file, HEARTBEAT)
        answer = b""
        while len(answer) < 7:
            answer += os.read(file, 7)
        return answer
    finally:
        os.close(file)


def test_a_fault_lasts_as_long_as_its_block(sim_r150):
    with sim_r150.fault("mute", direction="to-client") as fault:
        assert fault.state["state"] == "active" and fault.hits == 0
    assert fault.state["state"] == "done"
    assert ask(sim_r150.port)[3] == 0x07
    assert sim_r150.report == []
    while "heartbeat" not in sim_r150.log:
        time.sleep(0.01)
    assert sim_r150.get("truth.at_rest") in (True, False) and sim_r150.get("truth.speed_mps") == 0.0


def test_what_is_wrong_is_said_in_words(sim_r150):
    with pytest.raises(rigsim.Refused, match="did you mean"):
        sim_r150.get("truth.sped_mps")
    with pytest.raises(rigsim.Refused, match="fault.kind"):
        sim_r150.fault("nonsense")
    with pytest.raises(rigsim.NotReached, match="far: expected `truth.x_m > 5`, but truth.x_m = 0"):
        sim_r150.until("truth.x_m > 5", within=0.01, message="far")


def test_a_simulator_that_is_not_closed_ends_with_its_program():
    program = "import rigsim; print(rigsim.start()._process.pid)"
    printed = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert printed.stderr == ""
    with pytest.raises(ProcessLookupError):
        os.kill(int(printed.stdout), 0)


def test_what_a_client_believes_is_a_name_of_conditions(sim_r150):
    sim_r150.publish(x=1.5, heading=-90)
    assert sim_r150.get("client.x") == 1.5
    sim_r150.until("client.heading + 90 == truth.x_m")
    with pytest.raises(rigsim.Refused, match="a name has"):
        sim_r150.publish(attached=1)


def test_a_running_simulator_is_found_by_its_port(sim):
    one, other = sim("r150"), sim("mecanum")
    assert rigsim.find(one.port).control.url == one.control.url
    assert rigsim.find(other.port).device.kind == "mecanum"
    with pytest.raises(rigsim.ControlError, match="that serves /nowhere"):
        rigsim.find("/nowhere")


@pytest.mark.sim(settings={"world.slope": "1 deg"}, seed=9)
def test_a_marker_says_how_it_is_started(sim_r150):
    assert sim_r150.control.state()["seed"] == 9
    assert "world.slope" in sim_r150.log


def test_time_and_events(sim_mecanum):
    events = sim_mecanum.events(names=["truth.x_m"], rate=5, timeout=60)
    assert next(event for event in events if event.kind == "values").data["values"] == {"truth.x_m": 0.0}
    sim_mecanum.pause()
    before = sim_mecanum.now
    sim_mecanum.advance_by("30 ms")
    assert sim_mecanum.now - before == pytest.approx(0.03)
    sim_mecanum.until("t > 0")
    for wait in [lambda: sim_mecanum.until("truth.x_m > 1"), lambda: sim_mecanum.advance("1 s")]:
        with pytest.raises(rigsim.ControlError, match="resume"):
            wait()
    sim_mecanum.speed = 5
    assert sim_mecanum.speed == 5
    sim_mecanum.resume()
    sim_mecanum.advance("50 ms")
    assert next(event for event in events if event.kind == "time").data["paused"]


def test_a_test_that_fails_shows_and_keeps_what_happened(pytester):
    pytester.makepyfile(
        """
        def test_it(sim_r150):
            with sim_r150.fault("push", ahead="3000 N"):
                sim_r150.until("truth.x_m > 0.1", within="60 s")
            sim_r150.operator("lock")
            assert False
        """
    )
    result = pytester.runpytest_subprocess("--sim-keep", "kept", "-p", "no:cacheprovider")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*- simulator, to its teardown -*", "*operator: lock*", "log, trace and picture: kept/*"])
    (folder,) = (pytester.path / "kept").iterdir()
    names = {path.name for path in folder.iterdir()}
    assert {"sim1-sim.log", "sim1-trace.jsonl", "sim1-picture.svg"} <= names
    assert "<polyline" in (folder / "sim1-picture.svg").read_text()
    assert subprocess.run([rigsim.program(), "replay", folder / "sim1-trace.jsonl"]).returncode == 0


def test_a_scenario_judges_a_test(pytester):
    # Tests have time enough until it is broken; the rest is played fast.
    stand = STAND % "70 s"
    (pytester.path / "good.toml").write_text(stand)
    (pytester.path / "bad.toml").write_text(stand + '[[never]]\nthat = "t > 60"\nmessage = "too late"\n')
    pytester.makepyfile(
        """
        import os, pytest

        @pytest.mark.scenario("good.toml")
        def test_good(sim_r150):
            os.close(os.open(sim_r150.port, os.O_RDWR | os.O_NOCTTY))
            sim_r150.until("t > 0.01", within="60 s")

        @pytest.mark.scenario("bad.toml")
        def test_bad(sim_r150):
            os.close(os.open(sim_r150.port, os.O_RDWR | os.O_NOCTTY))
            sim_r150.until("t > 0.01", within="60 s")
        """
    )
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    result.assert_outcomes(passed=2, errors=1)
    result.stdout.fnmatch_lines(["*too late*"])


def test_a_scenario_that_was_not_played_fails_its_test(pytester):
    (pytester.path / "stand.toml").write_text(STAND % "70 s")
    pytester.makepyfile(
        """
        import pytest

        pytestmark = pytest.mark.scenario("stand.toml")

        def test_that_opens_no_port(sim_r150):
            assert sim_r150.port

        def test_that_opens_no_port_in_time_that_passes(sim_r150):
            sim_r150.until("t > 0.01", within="60 s")

        def test_that_closes_it_itself(sim_r150):
            sim_r150.close()

        def test_without_a_simulator():
            pass

        def test_of_another_device(sim_mecanum):
            pass

        def test_with_a_rig(sim):
            sim(rig="rig.toml")
        """
    )
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    # What comes to light after a test is an error beside its pass.
    result.assert_outcomes(passed=3, failed=2, errors=4)
    said = result.stdout.str()
    assert said.count("the client ended without having opened a port") >= 3
    for part in ["it uses no simulator", "has no mecanum", "its own rig"]:
        assert part in said


def test_rigs_are_served_side_by_side(sim, tmp_path):
    rig = tmp_path / "rig.toml"
    device = '[[device]]\nkind = "%s"\nname = "%s"\nport = "%s"\n'
    port = tmp_path / "port"
    rig.write_text("schema = 1\n" + device % ("r150", "one", port) + device % ("mecanum", "two", f"{port}-2"))
    first, second = sim(rig=rig), sim(rig=rig)
    assert first["one"].port != second["one"].port and not port.exists()
    assert ask(first["one"].port)[3] == ask(second["one"].port)[3] == 0x07
    assert rigsim.find(second["two"].port).control.url == second.control.url
    with pytest.raises(AttributeError, match=r"simulator\['one'\].ports or simulator\['two'\].ports"):
        first.ports
    with pytest.raises(AttributeError, match="has no prots"):
        first.prots


def test_a_scenario_is_a_test(pytester):
    for name, rule in {"good": "", "bad": '[[never]]\nthat = "t > 0.2"\nmessage = "too late"\n'}.items():
        (pytester.path / f"{name}.toml").write_text(STAND % "500 ms" + rule)
    pytester.makepyfile(
        """
        import pytest, rigsim

        @pytest.mark.parametrize("scenario", rigsim.scenarios("good.toml", "bad.toml"))
        def test_it(sim_play, scenario):
            sim_play(scenario)
        """
    )
    result = pytester.runpytest_subprocess("--sim-keep", "kept", "-p", "no:cacheprovider")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*FAILED  bad.toml: Stand*", "*too late*"])
    (folder,) = (pytester.path / "kept").iterdir()
    assert [path.name for path in folder.glob("*.trace.jsonl")] == ["bad.trace.jsonl"]
    with pytest.raises(ValueError, match="nowhere.toml"):
        rigsim.scenarios("nowhere.toml")


def test_tests_run_in_parallel(pytester):
    pytest.importorskip("xdist")
    pytester.makepyfile(
        """
        import pytest

        @pytest.mark.parametrize("number", range(4))
        def test_it(sim_r150, number):
            assert sim_r150.get("truth.x_m") == 0
        """
    )
    result = pytester.runpytest_subprocess("-n", "2", "-p", "no:cacheprovider")
    result.assert_outcomes(passed=4)


TEST = """
import pytest, rigsim

def test_it(sim_r150):
    import os
    file = os.open(sim_r150.port, os.O_RDWR | os.O_NOCTTY)
    assert sim_r150.joined and sim_r150.time == "lockstep"
    for change in ["pause", "resume", lambda: sim_r150.advance_by(1), lambda: sim_r150.speed]:
        with pytest.raises(rigsim.ControlError, match="time is the client's"):
            change() if callable(change) else getattr(sim_r150, change)()
    with sim_r150.fault("mute", direction="to-client"):
        sim_r150.advance("100 s")
    sim_r150.until("t > 200", within="200 s")
    os.close(file)
"""


def test_the_fixtures_join_the_run_that_plays_them(tmp_path):
    (tmp_path / "stand.toml").write_text(STAND % "10 min")
    (tmp_path / "test_it.py").write_text(textwrap.dedent(TEST))
    client = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py"]

    def run(*flags):
        command = [rigsim.program(), "run", "--seed", "1", *flags, "stand.toml", "--", *client]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)

    ended = run("--control", "127.0.0.1:0")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "not repeatable" not in ended.stdout
    # No test has opened a port, so there is nothing to judge.
    ended = run()
    assert ended.returncode == 3 and "--control 127.0.0.1:0" in ended.stdout, ended.stdout + ended.stderr


REFUSED = """
import pytest

@pytest.mark.scenario("cable.toml")
def test_scenario(sim_r150): pass

@pytest.mark.sim(settings={"world.slope": "1 deg"})
def test_settings(sim_r150): pass

def test_seed(sim): sim("r150", seed=9)

def test_world(sim): sim("r150", world="yard.toml")

def test_rig(sim): sim(rig="rig.toml")

def test_two(sim): sim("r150"), sim("r150")

def test_other(sim_mecanum): pass

@pytest.mark.sim(seed=1, speed=4)
def test_what_the_run_has(sim_r150): open(sim_r150.port, "rb", buffering=0).close()
"""


def test_what_the_run_around_a_test_does_not_have_is_refused(tmp_path):
    (tmp_path / "stand.toml").write_text(STAND % "10 min")
    (tmp_path / "test_it.py").write_text(REFUSED)

    def run(code, *flags):
        client = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *flags, "test_it.py"]
        command = [rigsim.program(), "run", "--seed", "1", "--control", "127.0.0.1:0", "--output", "out"]
        command += ["stand.toml", "--", *client]
        ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert ended.returncode == code, ended.stdout + ended.stderr
        return (tmp_path / "out" / "stand.client.log").read_text()

    said = run(1)
    assert "4 failed, 1 passed, 3 errors" in said, said
    for part in [
        "asks for scenario cable.toml (its scenario marker), and cannot have it",
        "settings {'world.slope': '1 deg'} (its sim marker)",
        "seed 9 (its call of sim())",
        "world 'yard.toml' (its call of sim())",
        "rig 'rig.toml' (its call of sim())",
        "no further r150",
        "no mecanum for this test; it has r150",
    ]:
        assert part in said, said
    # The one test that is left opens no port.
    said = run(3, "--sim-set", "world.slope=1 deg", "--sim-seed", "9", "-k", "has")
    assert "settings {'world.slope': '1 deg'} (the options of pytest)" in said, said
    assert "seed 9 (the options of pytest)" in said, said


def test_a_failure_is_shown_on_the_line_of_its_rule(tmp_path):
    scenario = tmp_path / "stuck.toml"
    rule = '[[step]]\nat = "1 s"\nexpect = { that = "truth.distance_m > 1" }\n'
    scenario.write_text(STAND.replace("Stand", "Stuck, at 100%%") % "2 s" + rule)
    run = [rigsim.program(), "run", "--seed", "1", "--junit", "junit.xml", "stuck.toml"]
    assert subprocess.run(run, cwd=tmp_path, check=False).returncode == 1
    annotate = [sys.executable, "-m", "rigsim.annotate"]
    printed = subprocess.run([*annotate, "junit.xml"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert printed.startswith("::error file=stuck.toml,line=8,title=Stuck%2C at 100%25::1.000000 s, ")
    assert printed.count("\n") == 1
    subprocess.run([*annotate, "--gitlab", "quality.json", "junit.xml"], cwd=tmp_path, check=True)
    (one,) = json.loads((tmp_path / "quality.json").read_text())
    assert one["location"] == {"path": "stuck.toml", "lines": {"begin": 8}} and "truth.distance_m > 1" in one["description"]
    # A file that is refused is not played.
    scenario.write_text(scenario.read_text() + "[[step]]\nfault = 1\n")
    with open(tmp_path / "check.txt", "w") as printed:
        subprocess.run([rigsim.program(), "check", "stuck.toml"], cwd=tmp_path, stderr=printed)
    checked = [*annotate, "--check", "check.txt", "--gitlab", "quality.json", "none.xml"]
    subprocess.run(checked, cwd=tmp_path, check=True)
    (one, *_) = json.loads((tmp_path / "quality.json").read_text())
    assert one["location"] == {"path": "stuck.toml", "lines": {"begin": 9}} and "step" in one["description"]
