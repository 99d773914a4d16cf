//! Simulations in simulated time, and served.

use std::io::{Read, Write};
use std::time::Duration;

use rigsim_core::mecanum::Mecanum;
use rigsim_core::r150_device::command::Request;
use rigsim_embed::{Error, ExpressionError, NewDevice, Simulation};

fn forward(power: i16) -> Vec<u8> {
    let (right, left) = (power, power);
    Request::SetMotors { right, left }.encode()
}

#[test]
fn what_makes_no_sense_is_named() {
    let message = |error: Error| error.to_string();
    let wrong = |kind| message(Simulation::of(kind).err().unwrap());
    assert!(wrong("r15").contains("r150"), "{}", wrong("r15"));
    let sim = Simulation::of("r150").unwrap();
    let r150 = sim.device("r150").unwrap();
    let name = message(r150.number("truth.speed_mp").unwrap_err());
    assert!(
        name.contains("did you mean `r150.truth.speed_mps`"),
        "{name}"
    );
    assert!(message(r150.number("truth.at_rest").unwrap_err()).contains("true or false"));
    assert!(message(sim.holds("t").unwrap_err()).contains("is a number"));
    let unfinished = sim.number("t >").unwrap_err();
    assert!(
        matches!(
            &unfinished,
            Error::Expression(ExpressionError::Unreadable { expression, at: 3, .. })
                if expression == "t >"
        ),
        "{unfinished:?}"
    );
    let fault = message(r150.fault("kind = \"bit-flip\"").err().unwrap());
    assert!(fault.contains("bit-flips"), "{fault}");
    assert!(message(r150.operator("jump").err().unwrap()).contains("lock"));
    assert!(message(sim.device("car").err().unwrap()).contains("r150"));
    let car = message(r150.look(|car: &Mecanum| car.truth()).unwrap_err());
    assert!(car.starts_with("r150 is not a "), "{car}");
    let setting = Simulation::builder().device("r150").set("r150.bawd", 9600);
    let setting = message(setting.build().err().unwrap());
    assert!(setting.contains("r150.baud"), "{setting}");
    let nowhere = Simulation::builder().rig_file("nowhere.toml").build();
    assert!(message(nowhere.err().unwrap()).contains("cannot read nowhere.toml"));
}

#[test]
fn several_devices_with_settings_stand_in_one_world() {
    let slow = NewDevice::new("r150").named("slow").at(0.0, 3.0, 90.0);
    let sim = Simulation::builder()
        .device(slow.set("battery.initial_soc", "50 %"))
        .device("mecanum")
        .set("r150.motor_watchdog", "200 ms")
        .seed(9)
        .build()
        .unwrap();
    assert_eq!(sim.number("slow.truth.y_m").unwrap(), 3.0);
    assert_eq!(sim.number("slow.truth.soc_percent").unwrap().round(), 50.0);
    let mut port = sim.device("slow").unwrap().open().unwrap();
    port.write_all(&forward(500)).unwrap();
    sim.wait_until("slow.count.watchdog_fired > 0", Duration::from_secs(1))
        .unwrap();
    assert!(sim.now().as_secs_f64() < 0.25);
    assert!(sim.holds("mecanum.truth.x_m < 0.1").unwrap());
}

#[test]
fn faults_people_and_the_world_act_on_request() {
    let sim = Simulation::of("r150").unwrap();
    let r150 = sim.device("r150").unwrap();
    let mut port = r150.open().unwrap();
    let mut drive = |seconds: u32| {
        for _ in 0..20 * seconds {
            port.write_all(&forward(400)).unwrap();
            sim.advance(Duration::from_millis(50)).unwrap();
        }
        r150.number("truth.speed_mps").unwrap()
    };
    assert!(drive(2) > 0.2);
    let stop = r150.operator("{ emergency_stop = true }").unwrap();
    assert!(drive(2) < 0.01);
    drop(stop);
    r150.operator("{ emergency_stop = false }").unwrap();
    sim.step("when = \"truth.speed_mps > 0.1\"\noperator = \"lock\"")
        .unwrap();
    assert!(drive(2) < 0.01);
    assert!(r150.flag("mode.locked").unwrap());
    let error = sim.wait_until("truth.x_m > 100", Duration::from_secs(1));
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("did not hold") && error.contains("truth.x_m = "),
        "{error}"
    );
}

const SCENARIO: &str = r#"
schema = 1
title = "There and no further, although bytes are lost on the way"
good_client = "Drives a metre ahead and stops."
limit = "20 s"

[[device]]
kind = "r150"

[[step]]
name = "noise"
at = "1 s"
fault = { kind = "dropped-bytes", probability = 0.05, direction = "to-device" }

[[step]]
at = "0 s"
expect = { that = "truth.x_m > 1 && truth.at_rest", within = "20 s" }

[[never]]
that = "truth.x_m > 2"
"#;

#[test]
fn a_scenario_judges_a_client_in_simulated_time() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("there.toml");
    std::fs::write(&file, SCENARIO).unwrap();
    let play = |goal_m: f64| {
        let sim = Simulation::builder().scenario_file(&file).build().unwrap();
        let mut port = sim.device("r150").unwrap().open().unwrap();
        while sim.number("truth.x_m").unwrap() < goal_m {
            port.write_all(&forward(500)).unwrap();
            sim.advance(Duration::from_millis(51)).unwrap();
        }
        for _ in 0..10 {
            port.write_all(&forward(0)).unwrap();
            sim.advance(Duration::from_millis(51)).unwrap();
        }
        drop(port);
        sim.finish().unwrap()
    };
    let outcome = play(1.1);
    assert!(outcome.passed, "{outcome:#?}");
    assert!(!play(0.5).passed);
    assert!(!play(2.2).passed);
}

#[test]
fn a_scenario_is_read_with_its_base_parameters_and_job() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    };
    write(
        "jobs/wall.toml",
        "schema = 1\n[[box]]\nat_m = [2, 0]\nlength = \"0.2 m\"\nwidth = \"2 m\"\n",
    );
    let job = |limit: &str| {
        format!(
            "schema = 1\ntitle = \"t\"\ngood_client = \"g\"\nlimit = \"{limit}\"\nworld = \"wall.toml\"\n\
             device = [{{ kind = \"r150\" }}]\n[parameters]\nmost = 3\n\
             [[always]]\nthat = \"truth.x_m < param.most\"\n"
        )
    };
    write("jobs/short.toml", &job("2 s"));
    let long = write("jobs/long.toml", &job("6 s"));
    let fault = write(
        "faults/noise.toml",
        "schema = 1\ntitle = \"n\"\nbase = \"../jobs/short.toml\"\n\
         [[step]]\nat = \"50 %\"\nfault = { kind = \"bad-crc\" }\noptional = true\n",
    );
    let play = |builder: rigsim_embed::Builder| {
        let sim = builder.build().unwrap();
        let mut port = sim.device("r150").unwrap().open().unwrap();
        for _ in 0..100 {
            port.write_all(&forward(500)).unwrap();
            sim.advance(Duration::from_millis(60)).unwrap();
        }
        drop(port);
        let ran_into_wall = sim.number("truth.collisions").unwrap() > 0.0;
        (sim.finish().unwrap(), ran_into_wall)
    };
    let file = || Simulation::builder().scenario_file(&fault);
    let (outcome, ran_into_wall) = play(file());
    assert!(outcome.passed && !ran_into_wall, "{outcome:#?}");
    assert_eq!(outcome.faults.len(), 1);
    // Within the longer job it comes to the wall that stands beside the job.
    let (outcome, ran_into_wall) = play(file().job(&long));
    assert!(outcome.passed && ran_into_wall, "{outcome:#?}");
    assert!(!play(file().job(&long).parameter("most", 0.5)).0.passed);
    let missing = file().job("nowhere.toml").build().err().unwrap();
    assert!(missing.to_string().contains("cannot read nowhere.toml"));
}

#[test]
fn a_client_that_opens_a_path_is_served_until_the_end() {
    let served = Simulation::builder().device("r150").spawn().unwrap();
    let path = served.path().to_owned();
    assert_eq!(served.path_of("r150", 0).unwrap(), path);
    assert!(served.path_of("r150", 1).is_err());
    let port = serialport::new(path.to_string_lossy(), 115_200);
    // Real time; as long as it takes on a busy machine.
    let mut port = port.timeout(Duration::from_secs(20)).open().unwrap();
    port.write_all(&Request::Heartbeat.encode()).unwrap();
    let mut reply = [0; 7];
    port.read_exact(&mut reply).unwrap();
    assert_eq!(reply, [0xAA, 0x55, 1, 7, 1, 0xC6, 0x53]);
    drop(port);
    let outcome = served.stop().unwrap();
    assert_eq!(outcome.devices[0].report.requests, 1);

    let dir = tempfile::tempdir().unwrap();
    let link = dir.path().join("r150");
    let named = NewDevice::new("r150").with("port", link.to_str().unwrap());
    let served = Simulation::builder().device(named).spawn().unwrap();
    assert_eq!(served.path(), link);
    assert!(link.exists());
    drop(served);
    assert!(!link.exists());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}
