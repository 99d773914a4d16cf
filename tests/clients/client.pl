# Reads and waits with select; the port is opened again when it is gone.
use strict;
use warnings;
use Fcntl;
use Time::HiRes qw(sleep clock_gettime CLOCK_MONOTONIC);

my $motors = pack("H*", "aa5504122c012c011eb4");
my $port;

sub opened {
    until (sysopen($port, $ENV{SIM_R150_PORT}, O_RDWR | O_NOCTTY | O_NONBLOCK)) { sleep 0.03 }
    system("stty raw -echo 115200 <$ENV{SIM_R150_PORT}");
}

$| = 1;
opened();
my $bytes = 0;
for my $step (1 .. 25) {
    my $end = clock_gettime(CLOCK_MONOTONIC) + 0.1;
    my $is_there = defined syswrite($port, $motors);
    while ($is_there && (my $left = $end - clock_gettime(CLOCK_MONOTONIC)) > 0) {
        my $ready = "";
        vec($ready, fileno($port), 1) = 1;
        next unless select($ready, undef, undef, $left);
        my $count = sysread($port, my $got, 64);
        $is_there = $count;
        $bytes += $count if $count;
    }
    next if $is_there;
    close $port;
    opened();
    printf "came back in step %d at %.6f\n", $step, clock_gettime(CLOCK_MONOTONIC);
}
chomp(my $processors = `nproc`);
print "processors $processors\nbytes $bytes\n";
