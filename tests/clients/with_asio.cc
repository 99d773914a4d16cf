// The same with Asio, by itself or of Boost: a serial port, a timer, one loop.
#ifdef WITH_BOOST
#include <boost/asio.hpp>
namespace asio = boost::asio;
using boost::system::error_code;
#else
#include <asio.hpp>
using asio::error_code;
#endif
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <thread>

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

struct Client {
    asio::io_context context;
    asio::steady_timer timer{context};
    std::unique_ptr<asio::serial_port> port;
    unsigned char buffer[64];
    unsigned char motors[10] = {0xAA, 0x55, 4, 0x12, 0x2C, 1, 0x2C, 1, 0x1E, 0xB4};
    Clock::time_point start = Clock::now();
    long bytes = 0;
    bool again = false;

    void connect() {
        error_code error;
        port = std::make_unique<asio::serial_port>(context);
        port->open(getenv("SIM_R150_PORT"), error);
        if (!error) port->set_option(asio::serial_port_base::baud_rate(115200), error);
        if (error) {
            timer.expires_after(30ms);
            timer.async_wait([this](auto) { connect(); });
            return;
        }
        if (again) {
            auto at = std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - start);
            std::printf("came back at %ld us\n", (long)at.count());
        }
        again = true;
        listen();
        drive();
    }

    void listen() {
        port->async_read_some(asio::buffer(buffer), [this](auto error, std::size_t count) {
            bytes += count;
            if (!error) return listen();
            if (Clock::now() >= start + 2500ms) return;
            timer.cancel();
            port->close();
            connect();
        });
    }

    void drive() {
        if (Clock::now() >= start + 2500ms) {
            port->close();
            return;
        }
        error_code error;
        asio::write(*port, asio::buffer(motors), error);
        timer.expires_after(100ms);
        timer.async_wait([this](auto error) {
            if (!error) drive();
        });
    }
};

int main() {
    Client client;
    client.connect();
    client.context.run();
    std::printf("processors %u\n", std::thread::hardware_concurrency());
    std::printf("bytes %ld\n", client.bytes);
}
