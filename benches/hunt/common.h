// What both clients of this bench need: one seeded bug by its name, a clock, and a port that may hang up.
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static const char *seeded = "none";

// Whether this is the bug that the client has.
#define BUG(name) (strcmp(seeded, #name) == 0)

// Seeded bugs that end a client, as a failed assertion would.
static void crash(void) { abort(); }

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + t.tv_nsec / 1e9;
}

static void rest(double seconds) {
    struct timespec t = {(time_t)seconds, (long)((seconds - (time_t)seconds) * 1e9)};
    nanosleep(&t, NULL);
}

struct port {
    const char *path;
    speed_t baud;
    int fd, hangups;
    double settle; // adapters pass a frame on in pieces, s
    uint8_t data[4096];
    size_t size;
};

static int try_open(struct port *port) {
    int fd = open(port->path, O_RDWR | O_NOCTTY | O_NONBLOCK);
    struct termios form;
    if (fd < 0) return 0;
    if (tcgetattr(fd, &form) != 0) {
        close(fd);
        return 0;
    }
    cfmakeraw(&form);
    cfsetspeed(&form, port->baud);
    if (tcsetattr(fd, TCSANOW, &form) != 0) {
        close(fd);
        return 0;
    }
    port->fd = fd;
    port->size = 0;
    return 1;
}

// Opens the port within so many seconds; returns whether it is there.
static int reopen(struct port *port, double patience) {
    double end = now() + patience;
    if (port->fd >= 0) close(port->fd);
    port->fd = -1;
    while (!try_open(port)) {
        if (now() > end) return 0;
        rest(0.05);
    }
    return 1;
}

// Takes what has come; -1 if the port has hung up.
static int collect(struct port *port) {
    if (port->size == sizeof port->data) port->size = 0;
    ssize_t got = read(port->fd, port->data + port->size, sizeof port->data - port->size);
    if (got > 0) {
        port->size += (size_t)got;
        return 1;
    }
    if (got < 0 && (errno == EAGAIN || errno == EINTR)) return 0;
    port->hangups += 1;
    return -1;
}

// Waits until something comes or that time, and takes it; -1 if the port has hung up.
static int take(struct port *port, double until) {
    double left = until - now();
    struct pollfd look = {port->fd, POLLIN, 0};
    if (poll(&look, 1, left > 0 ? (int)ceil(left * 1e3) : 0) <= 0) return 0;
    if (!(look.revents & POLLHUP)) rest(port->settle);
    return collect(port);
}

// Sends all of it; -1 if the port has hung up.
static int give(struct port *port, const void *data, size_t size) {
    const uint8_t *rest_of = data;
    while (size > 0) {
        ssize_t put = write(port->fd, rest_of, size);
        if (put < 0 && errno == EAGAIN) {
            struct pollfd look = {port->fd, POLLOUT, 0};
            if (poll(&look, 1, 200) <= 0) return 0;
            continue;
        }
        if (put <= 0) {
            port->hangups += 1;
            return -1;
        }
        rest_of += put;
        size -= (size_t)put;
    }
    return 0;
}

// The first so many bytes are done with.
static void drop(struct port *port, size_t size) {
    memmove(port->data, port->data + size, port->size - size);
    port->size -= size;
}
