//! What a client that has left leaves behind is nobody's.

use super::*;
use crate::r150_device::codec::encode;

#[test]
fn a_request_inside_a_torn_frame_of_a_former_client_is_not_answered_to_the_next() {
    let port = PortId { device: 0, link: 0 };
    for arrived in [false, true] {
        let mut rig = Rig::new(RigSettings {
            world: WorldSettings::default(),
            map: WorldMap::default(),
            wire: Wire::Paced,
            seed: 1,
        });
        crate::r150::add(
            &mut rig,
            "r150",
            &R150Settings::default(),
            Start::Ready,
            Pose::default(),
        );
        rig.attach(port, SimTime::ZERO).unwrap();
        // A frame of which most is missing holds a whole one, found when it is given up.
        let torn = [&[0xAA, 0x55, 40, 6][..], &encode(0x07, &[])].concat();
        rig.client_sends(port, SimTime::ZERO, &torn).unwrap();
        let mut now = SimTime::ZERO;
        if arrived {
            now += Duration::from_millis(2);
            rig.advance(now).unwrap();
        }
        rig.detach(port, now).unwrap();
        rig.attach(port, now).unwrap();
        now += Duration::from_millis(200);
        rig.advance(now).unwrap();
        let mut bytes = Vec::new();
        rig.client_reads(port, &mut bytes);
        assert!(bytes.is_empty(), "{bytes:02X?}");
        // The next client's own request is answered.
        rig.client_sends(port, now, &encode(0x07, &[])).unwrap();
        rig.advance(now + Duration::from_millis(20)).unwrap();
        rig.client_reads(port, &mut bytes);
        assert_eq!(bytes, encode(0x07, &[1]));
    }
}
