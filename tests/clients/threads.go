// Drives from one goroutine, listens with another; channels and timers between them.
package main

import (
	"fmt"
	"os"
	"runtime"
	"time"
)

var motors = []byte{0xAA, 0x55, 4, 0x12, 0x2C, 1, 0x2C, 1, 0x1E, 0xB4}

func connect() *os.File {
	for {
		port, err := os.OpenFile(os.Getenv("SIM_R150_PORT"), os.O_RDWR, 0)
		if err == nil {
			return port
		}
		time.Sleep(30 * time.Millisecond)
	}
}

func listen(port *os.File, counts chan<- int) {
	buffer := make([]byte, 64)
	for {
		count, err := port.Read(buffer)
		if err != nil || count == 0 {
			close(counts)
			return
		}
		counts <- count
	}
}

func main() {
	start, bytes := time.Now(), 0
	port, counts := connect(), make(chan int)
	go listen(port, counts)
	tick := time.NewTicker(100 * time.Millisecond)
	end := time.After(2500 * time.Millisecond)
	for {
		select {
		case <-end:
			fmt.Println("processors", runtime.NumCPU())
			fmt.Println("bytes", bytes)
			return
		case <-tick.C:
			port.Write(motors)
		case count, open := <-counts:
			bytes += count
			if !open {
				port.Close()
				port, counts = connect(), make(chan int)
				go listen(port, counts)
				fmt.Println("came back at", time.Since(start))
			}
		}
	}
}
