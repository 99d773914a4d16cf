//! The `ctl` subcommand: what the control socket offers, from a shell.

use std::io::Write as _;
use std::path::PathBuf;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use anyhow::anyhow;
use clap::{Args, Subcommand};
use serde_json::{Map, Value, json};
use sim_control::client::{CallError, Client, escape};
use sim_control::session::Session;
use sim_settings::Span;

use crate::exit::{Exit, Failure};
use crate::print::{complain, print, written};
use crate::visible;

const EXAMPLES: &str = "\
Examples:
  sim --pty /tmp/r150 --control 127.0.0.1:0
      Start a simulator that can be controlled, in another terminal.
  sim ctl fault cable-pulled --for 2s
      Break something for a time. `sim faults` lists what can be broken.
  sim ctl fault bit-flips probability=0.01 direction=to-client
      Break something until it is cleared.
  sim ctl clear
      Mend all that was broken from here.
  sim ctl get truth.speed_mps truth.at_rest
      Print values. `sim names` lists the names.
  sim ctl until truth.at_rest --within 2s
      Wait in simulated time; exit code 1 if it does not come.
  sim ctl operator emergency_stop true
      Push the emergency stop.
  sim ctl world friction 0.1 --for 5s
      Make the ground slippery for a time.
  sim ctl pause; sim ctl step-by 50ms; sim ctl go-on; sim ctl speed 0.5
      Stop time, let 50 ms pass, let it go on, at half speed.
  sim ctl --port /tmp/r150 state
      Of several simulators, ask the one that serves this port.";

/// Time between two looks whether what is waited for cannot come.
const LOOK: Duration = Duration::from_millis(500);

/// Something to do.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CtlArgs {
    /// The simulator that serves this port; not needed if only one runs, or in a client of `sim run`.
    #[arg(long, value_name = "PATH", global = true)]
    port: Option<PathBuf>,
    /// The simulator at this URL, which it has printed.
    #[arg(
        long,
        env = "SIM_CONTROL",
        value_name = "URL",
        hide_env_values = true,
        global = true
    )]
    url: Option<String>,
    /// The device, if there are several.
    #[arg(long, value_name = "NAME", global = true)]
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
      Prints the name of the step, which `sim ctl clear NAME` ends.")]
    Fault {
        /// The fault, as `sim faults` lists it.
        kind: String,
        /// Its parameters, as in probability=0.01.
        #[arg(value_name = "NAME=VALUE")]
        parameters: Vec<String>,
        #[command(flatten)]
        lasts: Lasts,
    },
    /// Do something to the vehicle by hand, as in `emergency_stop true`.
    #[command(after_help = "\
Examples:
  sim ctl operator lock
  sim ctl operator emergency_stop true --for 3s
  sim ctl operator push '{\"ahead\": \"400 N\"}' --for 500ms")]
    Operator {
        /// The action, as in the `operator` steps of scenario files.
        action: String,
        /// Its value, as a word or JSON.
        #[arg(allow_negative_numbers = true)]
        value: Option<String>,
        #[command(flatten)]
        lasts: Lasts,
    },
    /// Change something around the vehicle, as in `friction 0.1`.
    #[command(after_help = "\
Examples:
  sim ctl world friction 0.1 --for 5s
  sim ctl world add '{\"box\": [{\"at_m\": [3, 0], \"length\": \"0.3 m\", \"width\": \"1 m\"}]}'")]
    World {
        /// The change, as in the `world` steps of scenario files.
        change: String,
        /// Its value, as a word or JSON.
        #[arg(allow_negative_numbers = true)]
        value: String,
        #[command(flatten)]
        lasts: Lasts,
    },
    /// Do a step of a scenario file, given as JSON.
    #[command(after_help = "\
Example:
  sim ctl step '{\"when\": \"truth.x_m > 1\", \"for\": \"2 s\", \"fault\": {\"kind\": \"cable-pulled\"}}'")]
    Step {
        /// The step.
        step: String,
        /// Wait until it is over.
        #[arg(long)]
        wait: bool,
    },
    /// End steps before their time and mend what they broke: all that were asked for, or one.
    Clear {
        /// Name of the step, as `sim ctl steps` lists it.
        name: Option<String>,
    },
    /// List the steps and how far they are.
    Steps,
    /// Print values of names, or list the names.
    Get {
        /// Names, as in truth.speed_mps.
        names: Vec<String>,
    },
    /// Wait until a condition holds; exit code 1 if it does not in time.
    ///
    /// While time is paused, it goes on waiting.
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
    /// Stop simulated time.
    Pause,
    /// Let simulated time go on.
    GoOn,
    /// Let some simulated time pass, as in `50ms`, and stop it then.
    StepBy {
        /// Simulated time to pass.
        time: Span,
    },
    /// Change how fast simulated time passes.
    Speed {
        /// Simulated seconds for each second of real time, 0.01 to 100.
        speed: f64,
    },
    /// Print time, devices, world and steps, as JSON.
    State,
    /// Print what happens, as JSON, a line each, until Ctrl-C.
    #[command(after_help = "\
Example:
  sim ctl events --names truth.x_m,truth.speed_mps --rate 20 --traffic")]
    Events {
        /// Print the values of these names, too.
        #[arg(long, value_delimiter = ',')]
        names: Vec<String>,
        /// Number of times to print them a second, in real time.
        #[arg(long, default_value_t = 10.0)]
        rate: f64,
        /// Print every request and reply, too.
        #[arg(long)]
        traffic: bool,
    },
    /// Print the URL of the page.
    Url,
}

#[derive(Debug, Args)]
struct Lasts {
    /// Time that it lasts, in simulated time [default: until it is cleared].
    #[arg(long = "for", value_name = "TIME")]
    lasts: Option<Span>,
}

/// Does it.
pub(crate) fn run(args: &CtlArgs) -> Result<Exit, Failure> {
    let url = find(args)?;
    let client = Client::new(&url).map_err(Failure::usage)?;
    match &args.does {
        Does::Fault {
            kind,
            parameters,
            lasts,
        } => {
            let mut fault = Map::from_iter([("kind".to_owned(), json!(kind))]);
            for parameter in parameters {
                let (name, value) = parameter.split_once('=').ok_or_else(|| {
                    let why = anyhow!(
                        "a parameter is NAME=VALUE, not {}",
                        visible::line(parameter)
                    );
                    Failure::usage(why)
                })?;
                fault.insert(name.to_owned(), word_or_json(value));
            }
            add(args, &client, "fault", Value::Object(fault), lasts)
        }
        Does::Operator {
            action,
            value,
            lasts,
        } => {
            let value = match value {
                Some(value) => json!({ action: word_or_json(value) }),
                None => json!(action),
            };
            add(args, &client, "operator", value, lasts)
        }
        Does::World {
            change,
            value,
            lasts,
        } => add(
            args,
            &client,
            "world",
            json!({ change: word_or_json(value) }),
            lasts,
        ),
        Does::Step { step, wait } => {
            let step: Value = serde_json::from_str(step)
                .map_err(|error| Failure::usage(anyhow!("the step is no JSON: {error}")))?;
            over(args, &client, step, *wait)
        }
        Does::Clear { name } => {
            let path = match name {
                Some(name) => format!("/v1/steps/{}", escape(name)),
                None => "/v1/steps".to_owned(),
            };
            show(&call(&client, "DELETE", &path, None)?)
        }
        Does::Steps => {
            let steps = call(&client, "GET", "/v1/steps", None)?;
            let lines = steps["steps"].as_array().into_iter().flatten();
            let lines: Vec<String> = lines
                .map(|step| {
                    let text = |key: &str| step[key].as_str().unwrap_or_default().to_owned();
                    format!("{:<8} {}", text("state"), visible::line(&text("name")))
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
            let within = sim_settings::show_duration(within.0);
            let step = json!({"expect": {"that": condition, "within": within}});
            over(args, &client, step, true)
        }
        Does::Pause => time(&client, &json!("pause")),
        Does::GoOn => time(&client, &json!("go_on")),
        Does::StepBy { time: span } => {
            let span = sim_settings::show_duration(span.0);
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

/// JSON, or else a word.
fn word_or_json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|_| json!(text))
}

fn add(
    args: &CtlArgs,
    client: &Client,
    key: &str,
    what: Value,
    lasts: &Lasts,
) -> Result<Exit, Failure> {
    let mut step = json!({ key: what });
    if let Some(Span(lasts)) = lasts.lasts {
        step["for"] = json!(sim_settings::show_duration(lasts));
    }
    over(args, client, step, false)
}

/// Has a step done and says how far it is; it has failed if it is over and not done.
fn over(args: &CtlArgs, client: &Client, mut step: Value, wait: bool) -> Result<Exit, Failure> {
    if let Some(device) = &args.device {
        step["device"] = json!(device);
    }
    let path = if wait {
        "/v1/steps?wait=true"
    } else {
        "/v1/steps"
    };
    let told = thread::scope(|scope| {
        let (over, is_over) = mpsc::channel::<()>();
        if wait {
            scope.spawn(move || tell_of_pauses(client, &is_over));
        }
        let told = call(client, "POST", path, Some(&step));
        drop(over);
        told
    })?;
    if told["state"] == "failed" {
        let why = told["why"].as_str().unwrap_or("the step failed").to_owned();
        return Err(Failure {
            exit: Exit::Failed,
            error: anyhow!("{}", visible::lines(&why)),
        });
    }
    let text = |key: &str| told[key].as_str().unwrap_or_default().to_owned();
    print(&format!(
        "{}: {}",
        visible::line(&text("name")),
        text("state")
    ))
}

/// Says on standard error when somebody waits for what does not come while time stands still, until the
/// other end of `is_over` is dropped.
fn tell_of_pauses(client: &Client, is_over: &mpsc::Receiver<()>) {
    let mut is_told = false;
    while let Err(RecvTimeoutError::Timeout) = is_over.recv_timeout(LOOK) {
        let Ok(state) = client.call("GET", "/v1/state", None) else {
            return;
        };
        let is_paused = state["paused"] == true;
        if is_paused && !is_told {
            let t = &state["t"];
            complain(&format!(
                "time is paused at {t} s; this waits until it goes on: `sim ctl go-on`, or `sim ctl \
                 step-by 1s`"
            ));
        }
        is_told = is_paused;
    }
}

fn get(client: &Client, names: &[String]) -> Result<Exit, Failure> {
    let list: Vec<String> = names.iter().map(|name| escape(name)).collect();
    let told = call(
        client,
        "GET",
        &format!("/v1/names?names={}", list.join(",")),
        None,
    )?;
    let values: Vec<String> = names
        .iter()
        .map(|name| told["values"][name].to_string())
        .collect();
    print(&values.join("\n"))
}

fn time(client: &Client, change: &Value) -> Result<Exit, Failure> {
    let told = call(client, "POST", "/v1/time", Some(change))?;
    let stands = if told["paused"] == true {
        "paused"
    } else {
        "running"
    };
    print(&format!(
        "{stands} at {} s, speed {}",
        told["t"], told["speed"]
    ))
}

fn events(client: &Client, names: &[String], rate: f64, traffic: bool) -> Result<Exit, Failure> {
    let names: Vec<String> = names.iter().map(|name| escape(name)).collect();
    let mut path = format!("/v1/events?traffic={traffic}");
    if !names.is_empty() {
        path += &format!("&names={}&rate={rate}", names.join(","));
    }
    let mut printed = Ok(());
    let told = client.events(&path, |kind, data| {
        let line = format!("{{\"event\":\"{kind}\",\"data\":{data}}}");
        printed = writeln!(anstream::stdout(), "{}", visible::line(&line));
        printed.is_ok()
    });
    told.map_err(failed)?;
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
