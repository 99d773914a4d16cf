// Drives with one thread, listens with another; a condition reports the loss of the port.
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <mutex>
#include <termios.h>
#include <thread>
#include <unistd.h>

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

static const unsigned char motors[] = {0xAA, 0x55, 4, 0x12, 0x2C, 1, 0x2C, 1, 0x1E, 0xB4};
static std::mutex mutex;
static std::condition_variable changed;
static bool lost;
static long bytes;

static int connect() {
    for (;;) {
        int fd = open(getenv("SIM_R150_PORT"), O_RDWR | O_NOCTTY);
        if (fd >= 0) {
            termios settings;
            tcgetattr(fd, &settings);
            cfmakeraw(&settings);
            cfsetspeed(&settings, B115200);
            settings.c_cc[VMIN] = 0;
            settings.c_cc[VTIME] = 1;
            tcsetattr(fd, TCSANOW, &settings);
            return fd;
        }
        std::this_thread::sleep_for(30ms);
    }
}

static void listen(int fd) {
    unsigned char buffer[64];
    for (;;) {
        ssize_t count = read(fd, buffer, sizeof buffer);
        termios settings;
        std::lock_guard<std::mutex> guard(mutex);
        if (count < 0 || (count == 0 && tcgetattr(fd, &settings) != 0)) {
            lost = true;
            changed.notify_all();
            return;
        }
        bytes += count;
    }
}

int main() {
    auto start = Clock::now();
    int fd = connect();
    std::thread listener(listen, fd);
    while (Clock::now() < start + 2500ms) {
        bool gone = write(fd, motors, sizeof motors) < 0;
        std::unique_lock<std::mutex> guard(mutex);
        gone = changed.wait_for(guard, 100ms, [] { return lost; }) || gone;
        guard.unlock();
        if (gone) {
            listener.join();
            close(fd);
            lost = false;
            fd = connect();
            listener = std::thread(listen, fd);
            auto at = std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - start);
            std::printf("came back at %ld us\n", (long)at.count());
        }
    }
    std::printf("processors %u\n", std::thread::hardware_concurrency());
    std::printf("bytes %ld\n", bytes);
    std::fflush(stdout);
    _exit(0);
}
