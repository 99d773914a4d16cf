// A client on Boost.Asio: session PORT, or session HOST PORT for a connection

#include <boost/asio.hpp>
#include <chrono>
#include <iostream>
#include <thread>
#include <vector>

using namespace std::chrono_literals;
namespace asio = boost::asio;
using Bytes = std::vector<unsigned char>;

static Bytes frame(unsigned char command, Bytes parameters) {
    unsigned crc = 0xFFFF;
    auto add = [&](unsigned char byte) {
        crc ^= byte;
        for (int i = 0; i < 8; i++) crc = crc >> 1 ^ (crc & 1 ? 0x8408 : 0);
    };
    add(command);
    for (auto byte : parameters) add(byte);
    crc ^= 0xFFFF;
    Bytes bytes{0xAA, 0x55, static_cast<unsigned char>(parameters.size()), command};
    bytes.insert(bytes.end(), parameters.begin(), parameters.end());
    bytes.push_back(crc & 0xFF);
    bytes.push_back(crc >> 8);
    return bytes;
}

template <class Port>
static void ask(asio::io_context &context, Port &port, const Bytes &request, std::size_t length) {
    Bytes reply(length);
    bool done = false;
    asio::write(port, asio::buffer(request));
    asio::async_read(port, asio::buffer(reply),
                     [&](boost::system::error_code error, std::size_t) { done = !error; });
    context.restart();
    context.run_for(5s);
    if (!done || reply[0] != 0xAA || reply[3] != request[3]) {
        std::cerr << "no reply to " << int(request[3]) << "\n";
        std::exit(1);
    }
}

template <class Port> static void drive(asio::io_context &context, Port &port) {
    ask(context, port, frame(0xF0, {}), 14);
    for (int i = 0; i < 3; i++) {
        ask(context, port, frame(0x12, {200, 0, 200, 0}), 14);
        std::this_thread::sleep_for(60ms);
    }
    ask(context, port, frame(0x12, {0, 0, 0, 0}), 14);
}

int main(int count, char **arguments) {
    if (count < 2) return 2;
    using port_base = asio::serial_port_base;
    for (int round = 0; round < 2; round++) {
        asio::io_context context;
        if (count > 2) {
            asio::ip::tcp::socket socket(context);
            asio::connect(socket, asio::ip::tcp::resolver(context).resolve(arguments[1], arguments[2]));
            drive(context, socket);
            continue;
        }
        asio::serial_port port(context, arguments[1]);
        port.set_option(port_base::baud_rate(115200));
        port.set_option(port_base::character_size(8));
        port.set_option(port_base::parity(port_base::parity::none));
        port.set_option(port_base::stop_bits(port_base::stop_bits::one));
        ::tcflush(port.native_handle(), TCIOFLUSH);
        drive(context, port);
        port.set_option(port_base::baud_rate(9600));
        asio::write(port, asio::buffer(frame(0xF0, {})));
        std::this_thread::sleep_for(200ms);
        port.set_option(port_base::baud_rate(115200));
        std::this_thread::sleep_for(100ms);
        ::tcflush(port.native_handle(), TCIOFLUSH);
        ask(context, port, frame(0xF0, {}), 14);
    }
}
