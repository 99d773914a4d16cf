/* A client on libserialport: session PORT */

#include <libserialport.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void check(int result, const char *what) {
    if (result < 0) {
        fprintf(stderr, "%s: %s\n", what, sp_last_error_message());
        exit(1);
    }
}

static void ask(struct sp_port *port, const unsigned char *request, size_t size, size_t length) {
    unsigned char reply[256];
    check(sp_blocking_write(port, request, size, 5000), "write");
    int count = sp_blocking_read(port, reply, length, 5000);
    if (count != (int)length || reply[0] != 0xAA || reply[3] != request[3]) {
        fprintf(stderr, "%d bytes instead of %zu to 0x%02X\n", count, length, request[3]);
        exit(1);
    }
}

int main(int count, char **arguments) {
    static const unsigned char version[] = {0xAA, 0x55, 0, 0xF0, 0xF7, 0x07};
    static const unsigned char heartbeat[] = {0xAA, 0x55, 0, 0x07, 0xC7, 0x84};
    static const unsigned char drive[] = {0xAA, 0x55, 4, 0x12, 200, 0, 200, 0, 0xD4, 0xB7};
    static const unsigned char stop[] = {0xAA, 0x55, 4, 0x12, 0, 0, 0, 0, 0xBF, 0x6D};
    if (count < 2) return 2;
    for (int round = 0; round < 2; round++) {
        struct sp_port *port;
        check(sp_get_port_by_name(arguments[1], &port), "get");
        check(sp_open(port, SP_MODE_READ_WRITE), "open");
        check(sp_set_baudrate(port, 115200), "speed");
        check(sp_set_bits(port, 8), "bits");
        check(sp_set_parity(port, SP_PARITY_NONE), "parity");
        check(sp_set_flowcontrol(port, SP_FLOWCONTROL_NONE), "flow control");
        usleep(50000);
        check(sp_flush(port, SP_BUF_BOTH), "flush");
        ask(port, version, sizeof version, 14);
        ask(port, heartbeat, sizeof heartbeat, 7);
        for (int i = 0; i < 3; i++) {
            ask(port, drive, sizeof drive, 14);
            usleep(60000);
        }
        ask(port, stop, sizeof stop, 14);
        enum sp_signal lines;
        check(sp_set_dtr(port, SP_DTR_ON), "DTR");
        check(sp_set_rts(port, SP_RTS_OFF), "RTS");
        check(sp_get_signals(port, &lines), "lines");
        if (!(lines & SP_SIG_CTS)) {
            fprintf(stderr, "lines %d\n", lines);
            return 1;
        }
        check(sp_set_baudrate(port, 9600), "speed");
        check(sp_blocking_write(port, version, sizeof version, 5000), "write");
        usleep(200000);
        check(sp_set_baudrate(port, 115200), "speed");
        usleep(100000);
        check(sp_flush(port, SP_BUF_BOTH), "flush");
        ask(port, version, sizeof version, 14);
        check(sp_close(port), "close");
        sp_free_port(port);
    }
    return 0;
}
