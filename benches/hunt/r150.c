// A careful client of an R150 for the bench of `sim hunt`, with at most one seeded bug: `r150 BUG`.
//
// It switches 12 V A and 48 V on, drives ahead for four seconds, and stops. When something is wrong with the
// vehicle it stops for good; when it hears nothing, or its port hangs up, it stops, prepares again, goes on.
#include "common.h"

enum { VERSION = 0xF0, POWER = 0x02, INFO = 0x06, MOTORS = 0x12 };
enum { RAILS = 1 << 0 | 1 << 4 };
static const int DUTY = 357;
static const double TICK = 0.1, DRIVE = 4.0, SETTLE = 0.15;

static struct port port;
static uint8_t reply[256];
static double heard, informed, speeds_right;
static int duty, recoveries, strange, preparing, ticks;

static uint16_t crc16(const uint8_t *data, size_t size) {
    uint16_t crc = 0xFFFF;
    for (size_t at = 0; at < size; at++) {
        crc ^= data[at];
        for (int bit = 0; bit < 8; bit++) crc = crc & 1 ? crc >> 1 ^ 0x8408 : crc >> 1;
    }
    return crc ^ 0xFFFF;
}

static int length_of(int command) {
    switch (command) {
    case VERSION: return 8;
    case POWER: return 1;
    case INFO: return 76;
    case MOTORS: return 8;
    default: return -1;
    }
}

static void stop_for_good(const char *why) {
    printf("stopped for good: %s\n", why);
    exit(0);
}

static void lost(void);

static void send_request(int command, const void *parameters, size_t size) {
    uint8_t frame[16] = {0xAA, 0x55, (uint8_t)size, (uint8_t)command};
    memcpy(frame + 4, parameters, size);
    uint16_t crc = crc16(frame + 3, size + 1);
    frame[4 + size] = crc & 0xFF;
    frame[5 + size] = crc >> 8;
    if (give(&port, frame, size + 6) < 0) lost();
}

static void send_motors(int value) {
    int16_t both[2] = {(int16_t)value, (int16_t)value};
    send_request(MOTORS, both, 4);
}

// The next valid frame of what came; its command, or -1.
static int next_frame(void) {
    while (port.size >= 2) {
        if (port.data[0] != 0xAA || port.data[1] != 0x55) {
            drop(&port, 1);
            continue;
        }
        if (port.size < 4) return -1;
        size_t size = port.data[2];
        int command = port.data[3];
        if (length_of(command) != (int)size) {
            if (BUG(crash_on_wrong_length) && length_of(command) > 0 && size < 100) crash();
            drop(&port, 1);
            continue;
        }
        if (port.size < size + 6) return -1;
        uint16_t crc = port.data[4 + size] | port.data[5 + size] << 8;
        if (crc16(port.data + 3, size + 1) != crc) {
            if (BUG(crash_on_third_bad_crc) && strange == 2) crash();
            strange += 1;
            drop(&port, 1);
            continue;
        }
        memcpy(reply, port.data + 4, size);
        drop(&port, size + 6);
        return command;
    }
    return -1;
}

// A frame that comes until then; its command, or -1.
static int frame_until(double until) {
    for (;;) {
        int command = next_frame();
        if (command >= 0) {
            heard = now();
            return command;
        }
        if (now() >= until) return -1;
        if (take(&port, until) < 0) lost();
    }
}

// The port has hung up.
static void lost(void) {
    if (BUG(crash_on_hangup)) crash();
    if (BUG(crash_on_second_hangup) && port.hangups >= 2) crash();
    if (BUG(crash_on_hangup_while_settling) && preparing == 2) crash();
    if (BUG(crash_on_hangup_after_deaf) && recoveries > 0) crash();
    if (BUG(crash_on_hangup_after_bad_crc) && strange > 0) crash();
    if (!reopen(&port, 3.0)) stop_for_good("the port does not come back");
    heard = now();
}

static void ask(int command, const void *parameters, size_t size) {
    double end = now() + 3.0;
    for (int times = 0; now() < end; times++) {
        if (BUG(crash_on_lost_power_reply) && command == POWER && preparing && times == 1) crash();
        send_request(command, parameters, size);
        double until = now() + 0.2;
        int answered;
        while ((answered = frame_until(until)) >= 0) {
            if (answered == command) return;
        }
    }
    stop_for_good("no answer");
}

static void check_info(void) {
    uint32_t system;
    memcpy(&system, reply + 48, 4);
    int off = (reply[54] & RAILS) != RAILS;
    if (BUG(ignore_rails)) return;
    if (BUG(ignore_rails_while_48v_fails) && (reply[54] & 1)) return;
    if (BUG(ignore_rails_after_deaf) && recoveries > 0) return;
    if (BUG(trust_outputs_after_deaf) && recoveries > 0) return;
    if (system) stop_for_good("sysStatus");
    if (reply[52]) stop_for_good("the app has taken control");
    if (off) stop_for_good("an output is off");
}

static void prepare(void) {
    uint32_t mask = RAILS;
    preparing = 1;
    if (!BUG(trust_outputs_after_deaf) || recoveries == 0) {
        ask(VERSION, "", 0);
        preparing = 2;
        rest(SETTLE);
        ask(POWER, &mask, 4);
        if (reply[0] != 1) {
            if (BUG(crash_on_refused_power)) crash();
            ask(POWER, &mask, 4);
        }
        preparing = 3;
        rest(SETTLE);
        ask(INFO, "", 0);
        check_info();
    }
    preparing = 0;
    heard = informed = now();
    speeds_right = now() + 0.5;
}

static void check_motors(void) {
    int16_t right, left;
    uint16_t charge;
    memcpy(&right, reply, 2);
    memcpy(&left, reply + 2, 2);
    memcpy(&charge, reply + 4, 2);
    if (charge < 300 && !BUG(ignore_charge)) stop_for_good("too little charge");
    double wanted = duty * 1.513;
    int fine = fabs(right - wanted) < 0.4 * wanted && fabs(left - wanted) < 0.4 * wanted;
    if (BUG(ignore_left_side)) fine = fabs(right - wanted) < 0.4 * wanted;
    if (BUG(ignore_speeds)) fine = 1;
    if (BUG(ignore_speeds_after_hangup) && port.hangups > 0) fine = 1;
    if (BUG(ignore_speeds_after_deaf) && recoveries > 0) fine = 1;
    if (fine && speeds_right < now()) speeds_right = now();
    if (now() - speeds_right > 0.7) stop_for_good("wrong speeds");
}

static void drive(void) {
    duty = DUTY;
    for (ticks = 0; ticks * TICK < DRIVE; ticks++) {
        double begun = now();
        int replies = 0;
        send_motors(duty);
        if (begun - informed > 0.3) send_request(INFO, "", 0);
        int command;
        while ((command = frame_until(begun + TICK)) >= 0) {
            if (command == MOTORS) {
                replies += 1;
                check_motors();
            } else if (command == INFO) {
                informed = now();
                check_info();
            }
        }
        if (BUG(race_on_silent_start) && ticks == 1 && replies == 0 && now() - heard > 0.15) duty = 1000;
        // In the middle of the way the outputs are confirmed.
        if (ticks == 25) {
            uint32_t mask = RAILS;
            double before = now();
            ask(POWER, &mask, 4);
            if (BUG(race_on_slow_confirmation) && now() - before > 0.15) duty = 1000;
        }
        if (now() - heard > 0.4 || now() - informed > 1.2) {
            recoveries += 1;
            if (BUG(race_after_deaf)) duty = 1000;
            double end = now() + 0.3;
            send_motors(0);
            while (frame_until(end) >= 0) {}
            prepare();
        }
    }
}

static void stop(void) {
    for (int times = 0; times < 50; times++) {
        double until = now() + TICK;
        int command, heard_it = 0;
        send_motors(0);
        while ((command = frame_until(until)) >= 0) {
            int16_t speeds[2];
            memcpy(speeds, reply, 4);
            if (command != MOTORS) continue;
            heard_it = 1;
            if (!speeds[0] && !speeds[1]) return;
        }
        if (BUG(crash_on_silent_stop) && times == 0 && !heard_it) crash();
    }
}

int main(int count, char **words) {
    if (count > 1) seeded = words[1];
    port = (struct port){getenv("SIM_R150_PORT"), B115200, -1, 0, 0.004, {0}, 0};
    if (!reopen(&port, 3.0)) stop_for_good("no port");
    prepare();
    drive();
    stop();
    return 0;
}
