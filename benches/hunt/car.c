// A careful client of a mecanum car for the bench of `sim hunt`, with at most one seeded bug: `car BUG`.
//
// It drives a revolution ahead and half of one to the left by packets, and both back, ahead by a line on the ROS
// link. It watches in the status packets what comes of an order, and orders what is left. When something
// is wrong with the car it stops for good; when it hears nothing, a port hangs up, or something is near, it
// stops, waits, and goes on.
#include "common.h"

static const double DEAF = 0.5;
static const int NEAR = 350;

struct status {
    double at;
    int x, y, turned, infra, motors, mile, distances[8];
};

static struct port main_port, ros_port;
static struct status status, doubtful;
static int known, doubts, recoveries, stopping, ordering, blocks, side, speed = 300, remote;
static double greeted;

static void stop(void);

static void stop_for_good(const char *why) {
    static int again;
    printf("stopped for good: %s\n", why);
    if (!again++) stop();
    exit(0);
}

static void lost(struct port *port) {
    if (BUG(crash_on_hangup)) crash();
    if (BUG(crash_on_hangup_of_ros) && port == &ros_port) crash();
    if (BUG(crash_on_hangup_after_deaf) && recoveries > 0) crash();
    if (BUG(crash_on_hangup_while_stopping) && stopping) crash();
    if (BUG(crash_on_hangup_before_last_side) && side == 3 && ordering) crash();
    if (BUG(crash_on_hangup_after_block) && blocks > 0) crash();
    if (!reopen(port, 3.0)) stop_for_good("a port does not come back");
    // One that stays pulled for longer than 3 s hangs up twice, as the client gives up: only what comes back counts.
    static int reopenings;
    if (BUG(crash_on_second_reopening) && ++reopenings == 2) crash();
}

static void give_main(const void *data, size_t size) {
    if (give(&main_port, data, size) < 0) lost(&main_port);
}

static int number(const uint8_t *at) { return (int16_t)(at[0] | at[1] << 8); }

// Takes a packet apart; returns whether it is possible.
static int parse(const uint8_t *data, struct status *new) {
    *new = (struct status){now(), number(data + 7), number(data + 9), number(data + 11), data[19], data[36],
                           number(data + 37) & 0xFFFF, {0}};
    for (int at = 0; at < 8; at++) {
        new->distances[at] = number(data + 20 + 2 * at) & 0xFFFF;
        if (new->distances[at] < 20 || new->distances[at] > 4500) return 0;
    }
    return new->infra <= 1 && new->motors <= 3;
}

static int can_follow(const struct status *new, const struct status *old) {
    double time = new->at - old->at;
    int way = abs(new->x - old->x) > abs(new->y - old->y) ? abs(new->x - old->x) : abs(new->y - old->y);
    return way <= 3 + 10 * time && abs(new->turned - old->turned) <= 150 + 800 * time;
}

// Takes packets in until that time; returns whether a new one was believed.
static int next_status(double until) {
    static const uint8_t HELLO[] = {2, 4, 0, 0};
    for (;;) {
        while (main_port.size >= 39) {
            struct status new;
            if (main_port.data[0] != 0 || main_port.data[1] != 39 || !parse(main_port.data, &new)) {
                if (BUG(crash_on_strange_byte) && main_port.data[0] > 2) crash();
                drop(&main_port, 1);
                continue;
            }
            drop(&main_port, 39);
            if (known && !can_follow(&new, &status)) {
                int again = doubts > 0 && can_follow(&new, &doubtful);
                doubtful = new;
                doubts += 1;
                if (BUG(crash_on_second_doubt) && doubts == 2) crash();
                if (!again) continue;
                if (new.mile < 20 && status.mile > 40) stop_for_good("the board has begun again");
            }
            doubts = 0;
            status = new;
            known = 1;
            return 1;
        }
        if (now() >= until) return 0;
        if (now() - greeted > 0.25) {
            greeted = now();
            give_main(HELLO, sizeof HELLO);
        }
        double wake = until < greeted + 0.26 ? until : greeted + 0.26;
        if (take(&main_port, wake) < 0) lost(&main_port);
        ros_port.size = 0;
        if (collect(&ros_port) < 0) lost(&ros_port);
    }
}

static void send_motion(int index, int way, int rate) {
    uint8_t packet[] = {0, 9, 0, 1, (uint8_t)index, way & 0xFF, (uint8_t)(way >> 8), rate & 0xFF, (uint8_t)(rate >> 8)};
    give_main(packet, sizeof packet);
}

// Asks for standstill on both links until two packets in a row say so.
static void stop(void) {
    int standing = 0;
    stopping = 1;
    for (int times = 0; times < 50 && standing < 2; times++) {
        send_motion(0, 0, 0);
        if (give(&ros_port, "\nX0 \n", 5) < 0) lost(&ros_port);
        int heard = next_status(now() + 0.15);
        standing = heard && !status.motors ? standing + 1 : 0;
    }
    stopping = 0;
}

static void look(void) {
    if (!next_status(now() + 3.0)) stop_for_good("no status packets");
}

static int is_near(int axis, int sign) {
    if (axis == 1) return 0;
    if (BUG(ignore_person_after_deaf) && recoveries > 0) return 0;
    if (BUG(ignore_person)) return 0;
    int nearest = 5000;
    for (int at = 0; at < 4; at++) {
        int distance = status.distances[sign > 0 ? at : 4 + at];
        if (distance < nearest) nearest = distance;
    }
    if (BUG(ignore_rear) && sign < 0) return 0;
    return nearest < NEAR || (sign > 0 && status.infra);
}

static int position(int axis) { return axis == 0 ? status.x : status.y; }

// Watches the car on its way; returns whether it has stopped by itself.
static int watch(int axis, int corner) {
    double begun = now();
    int sign = corner > position(axis) ? 1 : -1, ran = 0, standing = 0, stuck = 0, strayed = 0;
    int nearest = (corner - position(axis)) * sign, first = nearest, aside = position(!axis), packets = 0;
    for (;;) {
        if (!next_status(now() + DEAF)) {
            recoveries += 1;
            if (BUG(race_after_deaf)) speed = 480;
            if (BUG(race_on_silent_order) && packets == 0) speed = 480;
            if (BUG(crash_on_silence_at_second_side) && side == 1 && packets < 2) crash();
            return 0;
        }
        packets += 1;
        int left = (corner - position(axis)) * sign;
        if (is_near(axis, sign)) {
            blocks += 1;
            if (BUG(race_after_block)) speed = 480;
            return 0;
        }
        strayed = abs(position(!axis) - aside) > 3 || abs(status.turned) > 80 ? strayed + 1 : 0;
        if (strayed == 3) stop_for_good("off course");
        if (left < -2 || left > first + 2) return 0;
        // Three tenths of a revolution in 1.5 s are slow.
        stuck = status.motors ? stuck + 1 : 0;
        if (left <= nearest - 3) nearest = left, stuck = 0;
        int ignores = BUG(ignore_stuck) || (BUG(ignore_stuck_after_hangup) && main_port.hangups > 0);
        if (stuck >= 15 && !ignores) stop_for_good("the motors run, and the car does not move");
        if (status.motors) {
            ran = 1;
            standing = 0;
        } else if (++standing >= 2 && (ran || now() - begun > 0.6)) {
            // In remote mode orders come to nothing.
            if (!ran && left > 1) remote += 1;
            return 1;
        }
    }
}

static void drive(int axis, int corner, int by_line) {
    for (int orders = 0;; orders++) {
        look();
        int way = corner - position(axis);
        if (abs(way) <= 1) return;
        if (orders == 8 || (remote >= 3)) stop_for_good("the car does not follow");
        double end = now() + 4.0;
        ordering = 1;
        for (int clear = 0; clear < 2;) {
            if (!next_status(now() + DEAF)) break;
            clear = is_near(axis, way) ? 0 : clear + 1;
            if (now() > end) stop_for_good("the way does not become clear");
        }
        if (by_line && orders < 1) {
            char line[16];
            int size = snprintf(line, sizeof line, "\n%c%d \n", axis == 0 ? 'X' : 'Y', way);
            if (give(&ros_port, line, (size_t)size) < 0) lost(&ros_port);
        } else {
            if (BUG(race_when_line_is_lost) && by_line) speed = 480;
            send_motion(axis == 0 ? 0 : 2, abs(way), way > 0 ? speed : -speed);
        }
        ordering = 0;
        if (!watch(axis, corner)) stop();
    }
}

int main(int count, char **words) {
    if (count > 1) seeded = words[1];
    main_port = (struct port){getenv("SIM_MECANUM_PORT"), B115200, -1, 0, 0.02, {0}, 0};
    ros_port = (struct port){getenv("SIM_MECANUM_ROS_PORT"), B9600, -1, 0, 0.02, {0}, 0};
    if (!reopen(&main_port, 3.0) || !reopen(&ros_port, 3.0)) stop_for_good("no port");
    static const int CORNERS[4] = {10, 5, 0, 0};
    look();
    for (side = 0; side < 4; side++) drive(side % 2, CORNERS[side], side == 2);
    stop();
    return 0;
}
