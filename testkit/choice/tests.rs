use super::*;
use std::collections::BTreeSet;

use rigsim_core::message::Sender;

/// Choices in numbers: each form with several values of each parameter.
fn choices() -> impl Iterator<Item = Choice> {
    let values = (0..=255).step_by(3).map(|value: u8| {
        let next = |by: u8| value.wrapping_mul(by).wrapping_add(by);
        [value, next(3), next(5), next(7), next(11), next(13)]
    });
    values.flat_map(|values| (0..=127).map(move |form| Choice { form, values }))
}

#[test]
fn every_effect_of_every_device_is_chosen() {
    for device in SHIPPED {
        let effects = choices().filter_map(|choice| choice.effect(device).ok());
        let chosen: BTreeSet<_> = effects.map(|effect| effect.info().id).collect();
        let all = effect::of(device).flat_map(|group| group.kinds);
        let missing: Vec<_> = all.filter(|info| !chosen.contains(info.id)).collect();
        assert!(missing.is_empty(), "{device:?}: {missing:?}");
    }
}

#[test]
fn most_choices_are_sound() {
    for device in SHIPPED {
        let wrong: Vec<String> = choices()
            .filter_map(|choice| choice.effect(device).err())
            .collect();
        let all = choices().count();
        let some: BTreeSet<_> = wrong.iter().take(20).collect();
        assert!(wrong.len() < all / 4, "{} of {all}: {some:?}", wrong.len());
    }
}

#[test]
fn every_command_of_every_device_is_chosen() {
    for device in SHIPPED {
        let settings = (device.settings)();
        for link in 0..device.links.len() {
            let commands = choices().filter_map(|choice| {
                let command = choice.command(device, link, &*settings).ok()?;
                command.command.or(command.bytes.first().copied())
            });
            let chosen: BTreeSet<u8> = commands.collect();
            let messages = device.all_messages();
            let of_client =
                messages.filter(|message| message.sender == Sender::Client && message.link == link);
            let all: BTreeSet<u8> = of_client.map(|message| message.id).collect();
            assert_eq!(chosen, all, "{device:?}");
        }
    }
}
