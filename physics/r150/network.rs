//! The electrical network: battery, bus, motors, rails.
//!
//! Everything hangs on one bus behind the battery's resistance. Motors are a resistance and a
//! source (the bridge a lossless transformer of ratio `duty`), resistive loads are conductances,
//! converters and electronic loads take constant power. The bus voltage `V` then obeys
//!
//! ```text
//! V = U − R (G V − I + P / V)      U, R battery; G, I, P sums over the loads
//! ```
//!
//! which is a quadratic with a closed solution, so nothing iterates and nothing can diverge. Where
//! the constant power exceeds what the source can give, the loads get the most that it can. Where the
//! source takes no charge, a brake resistor on the bus turns what the bridges feed back and no load
//! wants into heat: the bus then stays at `U`.

use super::signals::{Load, RAILS, Rail};

/// A source with its inner resistance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source {
    pub(super) voltage: f64,
    pub(super) resistance: f64,
}

/// A motor bridge as the bus sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct MotorPort {
    /// Set if current can flow.
    pub(super) connected: bool,
    pub(super) duty: f64,
    /// V
    pub(super) back_emf: f64,
    /// Ω
    pub(super) resistance: f64,
}

/// Outputs that are switched on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Demand {
    pub(super) source: Source,
    /// Set if current can flow into the source.
    pub(super) takes_charge: bool,
    pub(super) motors: [MotorPort; 2],
    /// Set if the tail supply is whole.
    pub(super) tail: bool,
    pub(super) rail_on: [bool; RAILS],
    pub(super) loads: [Load; RAILS],
    /// Power of the small modules behind their fuse, W.
    pub(super) small_modules: f64,
}

/// Voltages and currents everywhere.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Flow {
    pub(super) bus: f64,
    pub(super) battery_current: f64,
    /// Through the windings.
    pub(super) motor_current: [f64; 2],
    /// From the bus into the bridges.
    pub(super) motor_supply: [f64; 2],
    pub(super) tail_current: f64,
    pub(super) small_modules_current: f64,
    pub(super) module_powered: bool,
    pub(super) rail_voltage: [f64; RAILS],
    pub(super) rail_current: [f64; RAILS],
}

/// Linear and constant-power loads of the bus, summed.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    conductance: f64,
    injected: f64,
    power: f64,
}

pub(super) fn solve(demand: &Demand) -> Flow {
    let mut drives = Sum::default();
    for motor in demand.motors.iter().filter(|motor| motor.connected) {
        drives.conductance += motor.duty * motor.duty / motor.resistance;
        drives.injected += motor.duty * motor.back_emf / motor.resistance;
    }
    drives.power += demand.small_modules;

    let mut flow = Flow::default();
    let mut module = Sum::default();
    if demand.tail {
        module = module_loads(demand, &mut flow);
    }
    let (mut bus, mut given) = bus_voltage(demand, drives.plus(module));
    flow.module_powered = demand.tail && bus >= MINIMUM_VOLTAGE;
    if !flow.module_powered && demand.tail {
        flow = Flow::default();
        module = Sum::default();
        (bus, given) = bus_voltage(demand, drives);
    }
    // Below the knee of the supply every electronic load gets the same share of its power.
    let power_to_current = given / bus;

    flow.bus = bus;
    flow.battery_current = (demand.source.voltage - bus) / demand.source.resistance;
    flow.tail_current = module.conductance * bus + module.power * power_to_current;
    flow.small_modules_current = demand.small_modules * power_to_current;
    for (index, motor) in demand.motors.iter().enumerate() {
        if motor.connected {
            let current = (motor.duty * bus - motor.back_emf) / motor.resistance;
            flow.motor_current[index] = current;
            flow.motor_supply[index] = motor.duty * current;
        }
    }
    finish_48v(demand, power_to_current, &mut flow);
    flow
}

/// The bus under these loads, and the share of the constant power that it can give.
fn bus_voltage(demand: &Demand, sum: Sum) -> (f64, f64) {
    let source = demand.source;
    let (bus, given) = free_bus_voltage(source, sum);
    let surplus = bus > source.voltage && !demand.takes_charge;
    (if surplus { source.voltage } else { bus }, given)
}

/// The same without a brake resistor.
fn free_bus_voltage(source: Source, sum: Sum) -> (f64, f64) {
    let divider = 1.0 + source.resistance * sum.conductance;
    let open = (source.voltage + source.resistance * sum.injected) / divider;
    let resistance = source.resistance / divider;
    // A motor that is turned hard against its duty can pull the bus to nothing; the bridges' body
    // diodes then hold it near zero.
    let open = open.max(LOWEST_BUS);
    let power_limit = open * open / (4.0 * resistance);
    if sum.power <= power_limit {
        let root = (open * open - 4.0 * resistance * sum.power).max(0.0).sqrt();
        ((open + root) / 2.0, 1.0)
    } else {
        (open / 2.0, power_limit / sum.power)
    }
}

/// Voltage of the 12 V outputs without load, V (manual section 3).
pub(super) const VOLTAGE_12V: f64 = 12.0;
/// Voltage of the 5 V output without load, V (manual section 3).
const VOLTAGE_5V: f64 = 5.0;
/// Bus voltage under which the module and its converters stop, V: 12 V converters need a little more
/// than they give.
const MINIMUM_VOLTAGE: f64 = 14.0;
/// Source resistance of one 12 V output, Ω; a short then draws many times the limit.
const RESISTANCE_12V: f64 = 0.03;
/// Source resistance of the 5 V output, Ω; likewise.
const RESISTANCE_5V: f64 = 0.05;
/// Resistance from the bus to the 48 V output, Ω: a switch and a connector.
const RESISTANCE_48V: f64 = 0.01;
/// Resistance of a short circuit, in its wires, Ω: a metre of wire.
const SHORT_RESISTANCE: f64 = 0.02;
/// Power of the module itself, W; assumed: a controller and idle converters.
const OWN_POWER: f64 = 5.0;
/// Efficiency of the 12 V and 5 V converters; assumed: typical buck converters.
const CONVERTER_EFFICIENCY: f64 = 0.92;
/// Keeps divisions by the bus voltage bounded, V.
const LOWEST_BUS: f64 = 0.1;

/// Sums what the module draws and fills in the rails that do not depend on the bus.
fn module_loads(demand: &Demand, flow: &mut Flow) -> Sum {
    let mut sum = Sum {
        power: OWN_POWER,
        ..Sum::default()
    };
    for rail in Rail::ALL {
        let index = rail.index();
        if !demand.rail_on[index] {
            continue;
        }
        let load = demand.loads[index];
        let source = match rail {
            Rail::V48 => {
                match load {
                    Load::Open => {}
                    Load::Power(power) => sum.power += power,
                    Load::Resistance(_) | Load::Short => {
                        sum.conductance += 1.0 / resistance_48v(load);
                    }
                }
                continue;
            }
            Rail::V5 => Source {
                voltage: VOLTAGE_5V,
                resistance: RESISTANCE_5V,
            },
            Rail::V12A | Rail::V12B | Rail::V12C | Rail::V12D => Source {
                voltage: VOLTAGE_12V,
                resistance: RESISTANCE_12V,
            },
        };
        let (voltage, current) = converter_output(source, load);
        flow.rail_voltage[index] = voltage;
        flow.rail_current[index] = current;
        sum.power += source.voltage * current / CONVERTER_EFFICIENCY;
    }
    sum
}

/// Terminal voltage and current of a converter under a load.
fn converter_output(source: Source, load: Load) -> (f64, f64) {
    let across = |resistance: f64| {
        let current = source.voltage / (source.resistance + resistance);
        (current * resistance, current)
    };
    match load {
        Load::Open => (source.voltage, 0.0),
        Load::Resistance(resistance) => across(resistance),
        Load::Short => across(SHORT_RESISTANCE),
        Load::Power(power) => {
            let square = source.voltage * source.voltage - 4.0 * source.resistance * power;
            let voltage = (source.voltage + square.max(0.0).sqrt()) / 2.0;
            (voltage, (source.voltage - voltage) / source.resistance)
        }
    }
}

/// The 48 V output is the bus itself behind a switch, so it follows once the bus is known. The path
/// to an electronic load is taken as ideal, which keeps the bus equation closed; its loss would be
/// under 1 % of the load.
fn finish_48v(demand: &Demand, power_to_current: f64, flow: &mut Flow) {
    let index = Rail::V48.index();
    if !flow.module_powered || !demand.rail_on[index] {
        return;
    }
    let load = demand.loads[index];
    let current = match load {
        Load::Open => 0.0,
        Load::Power(power) => power * power_to_current,
        Load::Resistance(_) | Load::Short => flow.bus / resistance_48v(load),
    };
    flow.rail_current[index] = current;
    flow.rail_voltage[index] = match load {
        Load::Open | Load::Power(_) => flow.bus,
        Load::Resistance(_) | Load::Short => flow.bus - current * RESISTANCE_48V,
    };
}

/// From the bus through a resistive load, Ω.
fn resistance_48v(load: Load) -> f64 {
    RESISTANCE_48V
        + match load {
            Load::Resistance(resistance) => resistance,
            _ => SHORT_RESISTANCE,
        }
}

impl Sum {
    fn plus(self, other: Self) -> Self {
        Self {
            conductance: self.conductance + other.conductance,
            injected: self.injected + other.injected,
            power: self.power + other.power,
        }
    }
}
