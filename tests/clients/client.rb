# A thread reads, another drives with a timeout for each wait; the port is opened again when it is gone.
require "timeout"
require "etc"

MOTORS = ["aa5504122c012c011eb4"].pack("H*")

def connect
  loop do
    port = File.open(ENV["SIM_R150_PORT"], File::RDWR | File::NOCTTY)
    system("stty raw -echo 115200", in: port)
    return port
  rescue SystemCallError
    sleep 0.03
  end
end

def listen(port)
  Thread.new do
    count = 0
    begin
      loop { count += port.readpartial(64).size }
    rescue SystemCallError, IOError
      count
    end
  end
end

port = connect
reader = listen(port)
25.times do |step|
  begin
    port.syswrite(MOTORS)
    Timeout.timeout(0.1) { reader.join }
    raise IOError
  rescue Timeout::Error
    next
  rescue SystemCallError, IOError
    port.close
    port = connect
    reader = listen(port)
    puts "came back in step #{step} at #{Process.clock_gettime(Process::CLOCK_MONOTONIC).round(6)}"
  end
end
port.syswrite(MOTORS)
sleep 0.2
port.close
puts "processors #{Etc.nprocessors}"
puts "bytes #{reader.value}"
