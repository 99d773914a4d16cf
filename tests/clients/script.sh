# The same with what every system has: stty, cat, sleep.
motors='\xaa\x55\x04\x12\x2c\x01\x2c\x01\x1e\xb4'
attempts=0
connect() {
    until [ -e "$SIM_R150_PORT" ]; do sleep 0.03; done
    exec 3<>"$SIM_R150_PORT"
    stty raw -echo 115200 <&3
    cat <&3 >>replies &
    reader=$!
}
connect
for step in $(seq 25); do
    if ! printf "$motors" 2>/dev/null >&3; then
        kill $reader 2>/dev/null
        exec 3>&-
        connect
        echo "came back in step $step"
    fi
    sleep 0.1
done
kill $reader
echo "processors $(nproc --all)"
echo "bytes $(wc -c <replies)"
rm replies
