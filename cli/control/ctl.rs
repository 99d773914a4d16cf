//! The `ctl` subcommand: what the control socket offers, from a shell.

use std::io::Write as _;
use std::path::PathBuf;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use anyhow::anyhow;
use clap::{Args, Subcommand};
use rigsim_control::client::{CallError, Client, escape};
use rigsim_control::json;
use rigsim_settings::Span;
use serde_json::{Map, Value, json};

use super::session::Session;
use crate::exit::{Exit, Failure, refuse};
use crate::print::{complain, print, written};
use crate::visible;

const EXAMPLES: &str = "\
Examples:
  sim --pty /tmp/r150 --control 127.0.0.1:0
      Start a simulator that can be controlled, in another terminal.
  sim ctl fault cable-pulled --for 2s
      Break something for 2 s. `sim faults` lists all faults.
  sim ctl fault bit-flips probability=0.01 direction=to-client
      Break something until it is cleared.
  sim ctl clear
      Revert everything that was started with `sim ctl` or on the page.
  sim ctl get truth.speed_mps truth.at_rest
      Print values. `sim names` lists the names.
  sim ctl until truth.at_rest --within 2s
      Wait in simulated time; exit code 1 if the condition does not hold in time.
  sim ctl operator emergency_stop true
      Push the emergency stop.
  sim ctl world remove crate --for 5s
      Remove the obstacle `crate` for 5 s.
  sim ctl pause; sim ctl advance 50ms; sim ctl resume; sim ctl speed 0.5
      Pause, advance time by 50 ms, resume, and continue at half speed.
  sim ctl --port /tmp/r150 state
      Select the simulator that serves this port, if there are several.";

/// Time between two looks whether what is waited for cannot come.
const LOOK: Duration = Duration::from_millis(500);

/// Something to do.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CtlArgs {
    /// Select the simulator that serves this port; not needed if only one runs, or in a client of
    /// `sim run`.
    #[arg(long, value_name = "PATH", global = true)]
    port: Option<PathBuf>,
    /// Select the simulator by the URL that it printed.
    #[arg(
        long,
        env = "SIM_CONTROL",
        value_name = "URL",
        hide_env_values = true,
        global = true
    )]
    url: Option<String>,
    /// The device of a step, if there are several.
    // A global argument takes over the default of one with its id above, which `sim --device` is.
    #[arg(id = "ctl_device", long = "device", value_name = "NAME", global = true)]
    device: Option<String>,
    #[command(subcommand)]
    does: Does,
}

#[derive(Debug, Subcommand)]
enum Does {
    /// Break something.
    #[command(after_help = "\
Example:
  sim ctl fault bit-flips probability=0.01 --for 2s
      Print the name of the new step, which `sim ctl clear NAME` ends.")]
    Fault {
        /// The fault, as `sim faults` lists it.
        kind: String,
        /// Its parameters, as in probability=0.01.
        #[arg(value_name = "NAME=VALUE")]
        parameters: Vec<String>,
        #[command(flatten)]
        lasts: Lasts,
    },
    /// Do what an operator can do to the vehicle, as in `emergency_stop true`.
    #[command(after_help = "\
Examples:
  sim ctl operator lock
  sim ctl operator emergency_stop true --for 3s
  sim ctl operator press forward --for 500ms
  sim ctl operator place x=1m y=2m")]
    Operator {
        /// The action, as in the `operator` steps of scenario files.
        action: String,
        /// Its value, as a word or JSON; or its parts, as in x=1m y=2m.
        #[arg(allow_negative_numbers = true)]
        value: Vec<String>,
        #[command(flatten)]
        lasts: Lasts,
    },
    /// Change something around the vehicle, as in `remove crate`.
    #[command(after_help = "\
Examples:
  sim ctl world remove crate --for 5s
  sim ctl world add '{\"box\": [{\"at_m\": [3, 0], \"length\": \"0.3 m\", \"width\": \"1 m\"}]}'")]
    World {
        /// The change, as in the `world` steps of scenario files.
        change: String,
        /// Its value, as a word or JSON; or its parts, as in obstacle=gate x=1m y=2m.
        #[arg(allow_negative_numbers = true, required = true)]
        value: Vec<String>,
        #[command(flatten)]
        lasts: Lasts,
    },
    /// Add a step as in a scenario file, given as JSON.
    #[command(after_help = "\
Example:
  sim ctl step '{\"when\": \"truth.x_m > 1\", \"for\": \"2 s\", \"fault\": {\"kind\": \"cable-pulled\"}}'")]
    Step {
        /// The step.
        step: String,
        /// Wait until the step has ended.
        #[arg(long)]
        wait: bool,
    },
    /// Cancel one step, or all steps added here: active faults are reverted, pending ones never start.
    Clear {
        /// Name of the step, as `sim ctl steps` lists it.
        name: Option<String>,
    },
    /// List the steps with their states.
    Steps,
    /// Print values of names, or list the names.
    Get {
        /// Names, as in truth.speed_mps.
        names: Vec<String>,
    },
    /// Wait until a condition holds; exit code 1 if it does not in time.
    ///
    /// While time is paused, it continues to wait.
    #[command(after_help = "\
Example:
  sim ctl until 'truth.at_rest && truth.x_m > 2' --within 10s")]
    Until {
        /// The condition, as in scenario files.
        condition: String,
        /// Longest wait, in simulated time.
        #[arg(long, value_name = "TIME", default_value = "5s")]
        within: Span,
    },
    /// Publish numbers that a client believes, such as its position.
    #[command(after_help = "\
Example:
  sim ctl publish x=1.23 y=0.4
      Conditions and reports know them as client.x and client.y.")]
    Publish {
        /// The numbers by name.
        #[arg(value_name = "NAME=NUMBER", required = true)]
        values: Vec<String>,
    },
    /// Pause simulated time.
    Pause,
    /// Resume simulated time.
    Resume,
    /// Advance simulated time by a step, as in `50ms`, and pause.
    Advance {
        /// Simulated time by which to advance.
        time: Span,
    },
    /// Change the speed of simulated time.
    Speed {
        /// Simulated seconds for each second of real time, 0.01 to 100.
        #[arg(value_parser = speed)]
        speed: f64,
    },
    /// Print time, devices, world and steps, as JSON.
    State,
    /// Print events as they happen, one JSON object a line, until Ctrl-C.
    #[command(after_help = "\
Example:
  sim ctl events --names truth.x_m,truth.speed_mps --rate 20 --traffic")]
    Events {
        /// Also print the values of these names.
        #[arg(long, value_delimiter = ',')]
        names: Vec<String>,
        /// How often to print the values in a second of real time.
        #[arg(long, default_value_t = 10.0)]
        rate: f64,
        /// Also print every request and reply.
        #[arg(long)]
        traffic: bool,
    },
    /// Print the URL of the page.
    Url,
}

#[derive(Debug, Args)]
struct Lasts {
    /// Duration in simulated time [default: until it is cleared].
    #[arg(long = "for", value_name = "TIME")]
    lasts: Option<Span>,
}

/// Does it.
pub(crate) fn run(args: &CtlArgs) -> Result<Exit, Failure> {
    let url = find(args)?;
    let client = Client::new(&url).map_err(Failure::usage)?;
    if args.device.is_some() && matches!(args.does, Does::Get { .. } | Does::Events { .. }) {
        let why = "--device is for steps; a name begins with its device, as in r150.truth.x_m";
        refuse!(why);
    }
    match &args.does {
        Does::Fault {
            kind,
            parameters,
            lasts,
        } => {
            let mut fault = pairs(parameters)?;
            fault.insert("kind".to_owned(), json!(kind));
            let example = "fault bit-flips probability=0.01 --for 2s";
            add(args, &client, ("fault", example), fault.into(), lasts)
        }
        Does::Operator {
            action,
            value,
            lasts,
        } => {
            let what = match value.as_slice() {
                [] => json!(action),
                value => json!({ action: whole(value)? }),
            };
            let example = "operator emergency_stop true, or operator place x=1m y=2m";
            add(args, &client, ("operator", example), what, lasts)
        }
        Does::World {
            change,
            value,
            lasts,
        } => {
            let what = json!({ change: whole(value)? });
            let example = "world remove crate, or world move obstacle=gate x=1m y=2m";
            add(args, &client, ("world", example), what, lasts)
        }
        Does::Step { step, wait } => {
            let step = json::read(step.as_bytes())
                .map_err(|error| Failure::usage(anyhow!("the step is not JSON: {error}")))?;
            over(args, &client, step, *wait)
        }
        Does::Clear { name } => {
            let path = match name {
                Some(name) => format!("/v1/steps/{}", escape(name)),
                None => "/v1/steps".to_owned(),
            };
            let answer = call(&client, "DELETE", &path, None)?;
            let Some(names) = answer["cleared"].as_array() else {
                return show_step(&answer);
            };
            let names: Vec<&str> = names.iter().filter_map(Value::as_str).collect();
            match names.join(", ") {
                names if names.is_empty() => print("no step to clear"),
                names => print(&format!("cleared: {}", visible::line(&names))),
            }
        }
        Does::Steps => {
            let steps = call(&client, "GET", "/v1/steps", None)?;
            let lines = steps["steps"].as_array().into_iter().flatten();
            let lines: Vec<String> = lines
                .map(|step| {
                    let text = |key: &str| step[key].as_str().unwrap_or_default().to_owned();
                    let why = Some(text("why")).filter(|why| !why.is_empty());
                    let why = why.map_or_else(String::new, |why| format!(": {why}"));
                    let line = format!("{:<8} {}{why}", text("state"), text("name"));
                    visible::line(&line).into_owned()
                })
                .collect();
            print(&lines.join("\n"))
        }
        Does::Get { names } if names.is_empty() => {
            let names = call(&client, "GET", "/v1/names", None)?;
            let lines = names["names"].as_array().into_iter().flatten();
            let lines: Vec<String> = lines
                .map(|one| {
                    let text = |key: &str| one[key].as_str().unwrap_or_default();
                    format!(
                        "{:<36} {:<11} {}",
                        text("name"),
                        text("unit"),
                        text("meaning")
                    )
                })
                .collect();
            print(&lines.join("\n"))
        }
        Does::Get { names } => get(&client, names),
        Does::Until { condition, within } => {
            let within = rigsim_settings::show_duration(within.0);
            let step = json!({"expect": {"that": condition, "within": within}});
            over(args, &client, step, true)
        }
        Does::Publish { values } => {
            let values = pairs(values)?.into();
            call(&client, "POST", "/v1/published", Some(&values))?;
            Ok(Exit::Clean)
        }
        Does::Pause => time(&client, &json!("pause")),
        Does::Resume => time(&client, &json!("resume")),
        Does::Advance { time: span } => {
            let span = rigsim_settings::show_duration(span.0);
            time(&client, &json!({ "step": span }))
        }
        Does::Speed { speed } => time(&client, &json!({ "speed": speed })),
        Does::State => show(&call(&client, "GET", "/v1/state", None)?),
        Does::Events {
            names,
            rate,
            traffic,
        } => events(&client, names, *rate, *traffic),
        Does::Url => print(&url),
    }
}

/// The URL of the simulator that is meant.
fn find(args: &CtlArgs) -> Result<String, Failure> {
    if let (Some(url), None) = (&args.url, &args.port) {
        return Ok(url.clone());
    }
    let mut running = Session::running()
        .map_err(|error| Failure::system(anyhow!("cannot look for simulators: {error}")))?;
    if let Some(port) = &args.port {
        running.retain(|session| session.serves(port));
    }
    match running.as_slice() {
        [session] => Ok(session.url.clone()),
        [] => {
            let which = match &args.port {
                Some(port) => format!(" that serves {}", visible::name(port)),
                None => String::new(),
            };
            let why = anyhow!(
                "no simulator runs{which} with --control; start one with `sim --pty /tmp/r150 --control 127.0.0.1:0`"
            );
            Err(Failure::usage(why))
        }
        several => {
            let ports = several.iter().filter_map(|session| session.ports.first());
            let ports: Vec<String> = ports.map(visible::name).collect();
            let why = anyhow!(
                "several simulators run with --control; say with --port which, as {}",
                ports.join(" or ")
            );
            Err(Failure::usage(why))
        }
    }
}

pub(crate) fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok();
    speed
        .filter(|speed| (0.01..=100.0).contains(speed))
        .ok_or_else(|| format!("`{text}` is not such a number; allowed: 0.01 to 100, as in 0.5"))
}

/// JSON, or else a word.
fn word_or_json(text: &str) -> Result<Value, Failure> {
    match json::read(text.as_bytes()) {
        Ok(value) => Ok(value),
        Err(error) if text.starts_with(['{', '[', '"']) => {
            let why = anyhow!("{} is not JSON: {error}", visible::line(text));
            Err(Failure::usage(why))
        }
        Err(_) => Ok(json!(text)),
    }
}

/// A value: a word, JSON, or parts of a table.
fn whole(value: &[String]) -> Result<Value, Failure> {
    match value {
        [one] if !one.contains('=') => word_or_json(one),
        [one] if one.starts_with(['{', '[', '"']) => word_or_json(one),
        parts => Ok(pairs(parts)?.into()),
    }
}

/// The parts of a table, as in `x=1m`.
fn pairs(parts: &[String]) -> Result<Map<String, Value>, Failure> {
    let mut table = Map::new();
    for part in parts {
        let (name, value) = part.split_once('=').ok_or_else(|| {
            let part = visible::line(part);
            Failure::usage(anyhow!("{part}: wanted NAME=VALUE, as in x=1m"))
        })?;
        if table
            .insert(name.to_owned(), word_or_json(value)?)
            .is_some()
        {
            let name = visible::line(name);
            refuse!("{name} is given twice");
        }
    }
    Ok(table)
}

/// Adds a step that does something under a key; a refusal shows an example.
fn add(
    args: &CtlArgs,
    client: &Client,
    (key, example): (&str, &str),
    what: Value,
    lasts: &Lasts,
) -> Result<Exit, Failure> {
    let mut step = json!({ key: what });
    if let Some(Span(lasts)) = lasts.lasts {
        step["for"] = json!(rigsim_settings::show_duration(lasts));
    }
    over(args, client, step, false).map_err(|failure| match failure.exit {
        Exit::Usage => Failure::usage(anyhow!("{:#}\nas in: sim ctl {example}", failure.error)),
        _ => failure,
    })
}

/// Requests a step and returns how far it is; it has failed if it is over and not done.
fn over(args: &CtlArgs, client: &Client, mut step: Value, wait: bool) -> Result<Exit, Failure> {
    if let Some(device) = &args.device {
        step["device"] = json!(device);
    }
    let path = if wait {
        "/v1/steps?wait=true"
    } else {
        "/v1/steps"
    };
    let answer = thread::scope(|scope| {
        let (over, is_over) = mpsc::channel::<()>();
        if wait {
            scope.spawn(move || report_pauses(client, &is_over));
        }
        let answer = call(client, "POST", path, Some(&step));
        drop(over);
        answer
    })?;
    if answer["state"] == "failed" {
        let why = answer["why"]
            .as_str()
            .unwrap_or("the step failed")
            .to_owned();
        return Err(Failure {
            exit: Exit::Failed,
            error: anyhow!("{}", visible::lines(&why)),
        });
    }
    show_step(&answer)
}

/// Prints a step and its state.
fn show_step(step: &Value) -> Result<Exit, Failure> {
    let text = |key: &str| step[key].as_str().unwrap_or_default();
    let name = visible::line(text("name"));
    print(&format!("{name}: {}", text("state")))
}

/// Says on standard error when a request waits for what does not come while time stands still, until the
/// other end of `is_over` is dropped.
fn report_pauses(client: &Client, is_over: &mpsc::Receiver<()>) {
    let mut is_said = false;
    while let Err(RecvTimeoutError::Timeout) = is_over.recv_timeout(LOOK) {
        let Ok(state) = client.call("GET", "/v1/state", None) else {
            return;
        };
        let is_paused = state["paused"] == true;
        if is_paused && !is_said {
            let t = &state["t"];
            complain(&format!(
                "time is paused at {t} s; this waits until it goes on: `sim ctl resume`, or `sim ctl \
                 advance 1s`"
            ));
        }
        is_said = is_paused;
    }
}

fn get(client: &Client, names: &[String]) -> Result<Exit, Failure> {
    let list: Vec<String> = names.iter().map(|name| escape(name)).collect();
    let answer = call(
        client,
        "GET",
        &format!("/v1/names?names={}", list.join(",")),
        None,
    )?;
    let values: Vec<String> = names
        .iter()
        .map(|name| answer["values"][name].to_string())
        .collect();
    print(&values.join("\n"))
}

fn time(client: &Client, change: &Value) -> Result<Exit, Failure> {
    let answer = call(client, "POST", "/v1/time", Some(change))?;
    let stands = if answer["paused"] == true {
        "paused"
    } else {
        "running"
    };
    print(&format!(
        "{stands} at {} s, speed {}",
        answer["t"], answer["speed"]
    ))
}

fn events(client: &Client, names: &[String], rate: f64, traffic: bool) -> Result<Exit, Failure> {
    let names: Vec<String> = names.iter().map(|name| escape(name)).collect();
    let mut path = format!("/v1/events?traffic={traffic}");
    if !names.is_empty() {
        path += &format!("&names={}&rate={rate}", names.join(","));
    }
    let mut printed = Ok(());
    let ended = client.events(&path, |kind, data| {
        let line = format!("{{\"event\":\"{kind}\",\"data\":{data}}}");
        printed = writeln!(anstream::stdout(), "{}", visible::line(&line));
        printed.is_ok()
    });
    ended.map_err(failed)?;
    written(printed)
}

fn show(value: &Value) -> Result<Exit, Failure> {
    print(&format!("{value:#}"))
}

fn call(client: &Client, method: &str, path: &str, body: Option<&Value>) -> Result<Value, Failure> {
    client.call(method, path, body).map_err(failed)
}

fn failed(error: CallError) -> Failure {
    let shown = anyhow!("{}", visible::lines(&error.to_string()));
    match error {
        // It has ended, or there are too many.
        CallError::Refused { status: 503, .. } => Failure::system(shown),
        CallError::Refused { .. } | CallError::Url(_) => Failure::usage(shown),
        _ => Failure::system(shown),
    }
}
