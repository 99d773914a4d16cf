# socat has the port open, and is started again when that is gone.
motors='\xaa\x55\x04\x12\x2c\x01\x2c\x01\x1e\xb4'
drive() {
    for _ in $(seq "$1"); do
        printf "$motors"
        sleep 0.1
    done
}
for part in 1 2; do
    until [ -e "$SIM_R150_PORT" ]; do sleep 0.03; done
    [ $part = 1 ] || echo "came back"
    drive 15 | socat -t1 - "$SIM_R150_PORT,rawer,b115200" 2>/dev/null | wc -c
done
echo "processors $(nproc --all)"
