# Reads by events and drives by timers; the port is opened again when it is gone.
set motors [binary format H* aa5504122c012c011eb4]
set bytes 0
set step 0

proc connect {} {
    global port
    while {[catch {open $::env(SIM_R150_PORT) {RDWR NOCTTY}} port]} { after 30 }
    fconfigure $port -mode 115200,n,8,1 -blocking 0 -buffering none -translation binary
    fileevent $port readable receive
}
proc receive {} {
    global port bytes
    if {[catch {read $port} got] || [eof $port]} { again } else { incr bytes [string length $got] }
}
proc again {} {
    global port step
    catch {close $port}
    connect
    puts "came back in step $step at [clock microseconds]"
}
proc drive {} {
    global port motors step done
    if {[catch {puts -nonewline $port $motors}]} { again }
    if {[incr step] == 25} { set done 1 } else { after 100 drive }
}
connect
drive
vwait done
puts "processors [exec nproc]"
puts "bytes $bytes"
