import java.io.File;
import java.io.IOException;
import java.io.RandomAccessFile;
import java.util.concurrent.SynchronousQueue;
import java.util.concurrent.TimeUnit;

/** A thread reads, another drives; the port is opened again when it is gone. */
public class Client {
    static final byte[] MOTORS = {(byte) 0xaa, 0x55, 4, 0x12, 0x2c, 1, 0x2c, 1, 0x1e, (byte) 0xb4};
    static final String NAME = System.getenv("SIM_R150_PORT");

    static RandomAccessFile connect() throws Exception {
        while (true) {
            try {
                if (!new File(NAME).exists()) {
                    throw new IOException("the file would be made");
                }
                RandomAccessFile port = new RandomAccessFile(NAME, "rw");
                new ProcessBuilder("sh", "-c", "stty raw -echo 115200 <" + NAME).start().waitFor();
                return port;
            } catch (IOException gone) {
                Thread.sleep(30);
            }
        }
    }

    static SynchronousQueue<Integer> listen(RandomAccessFile port) {
        SynchronousQueue<Integer> gone = new SynchronousQueue<>();
        Thread reader = new Thread(() -> {
            int count = 0;
            try {
                while (port.read() >= 0) {
                    count++;
                }
            } catch (IOException end) {
                // It is gone.
            }
            gone.offer(count);
        });
        reader.setDaemon(true);
        reader.start();
        return gone;
    }

    public static void main(String[] arguments) throws Exception {
        RandomAccessFile port = connect();
        SynchronousQueue<Integer> gone = listen(port);
        for (int step = 0; step < 25; step++) {
            boolean isThere = true;
            try {
                port.write(MOTORS);
                isThere = gone.poll(100, TimeUnit.MILLISECONDS) == null;
            } catch (IOException end) {
                isThere = false;
            }
            if (!isThere) {
                port.close();
                port = connect();
                gone = listen(port);
                System.out.println("came back in step " + step + " at " + System.nanoTime());
            }
        }
        System.out.println("processors " + Runtime.getRuntime().availableProcessors());
    }
}
