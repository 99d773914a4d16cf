<?php
// Reads and waits with stream_select; the port is opened again when it is gone.
function connect()
{
    // PHP keeps for two minutes where a link led to.
    clearstatcache(true);
    while (!($port = @fopen(getenv('SIM_R150_PORT'), 'r+b'))) {
        usleep(30000);
    }
    stream_set_blocking($port, false);
    stream_set_read_buffer($port, 0);
    exec('stty raw -echo 115200 <' . getenv('SIM_R150_PORT'));
    return $port;
}

$motors = hex2bin('aa5504122c012c011eb4');
$port = connect();
$bytes = 0;
for ($step = 0; $step < 25; $step++) {
    $end = hrtime(true) + 100000000;
    $is_there = @fwrite($port, $motors) !== false;
    while ($is_there && ($left = $end - hrtime(true)) > 0) {
        [$ready, $none] = [[$port], null];
        if (stream_select($ready, $none, $none, 0, intdiv($left, 1000)) === 0) {
            continue;
        }
        $got = fread($port, 64);
        $is_there = $got !== false && $got !== '';
        $bytes += $is_there ? strlen($got) : 0;
    }
    if (!$is_there) {
        fclose($port);
        $port = connect();
        printf("came back in step %d at %d\n", $step, hrtime(true));
    }
}
printf("processors %s\nbytes %d\n", trim(shell_exec('nproc')), $bytes);
