//! A broker that accepts less than it is sent: refusals of single publications, and its own bound on open ones.

use super::super::stub::Published;
use super::*;

/// PUBACK with a reason, as only MQTT 5 has it.
async fn answer(peer: &mut Peer, identifier: u16, reason: u8) {
    let [high, low] = identifier.to_be_bytes();
    peer.send(0x40, &[high, low, reason, 0]).await;
}

#[tokio::test]
async fn a_refused_publication_is_reported_with_what_it_means() {
    let version = MqttVersion::V5;
    let reasons = [
        (0x80, PublicationRefusal::Failed),
        (0x83, PublicationRefusal::Failed),
        (0x87, PublicationRefusal::Never),
        (0x90, PublicationRefusal::Never),
        (0x97, PublicationRefusal::Full),
        (0x99, PublicationRefusal::Never),
    ];
    let count = reasons.len() as u64;
    let stub = Stub::new(version).await;
    let rig = Rig::greeting((0..=count).map(with_token).collect());
    let events = rig
        .run(&stub, version, async {
            let mut peer = stub.welcome().await;
            for (reason, _) in reasons {
                let identifier = peer.published().await.identifier;
                answer(&mut peer, identifier, reason).await;
            }
            // The code for no matching subscribers is not a refusal.
            let identifier = peer.published().await.identifier;
            answer(&mut peer, identifier, 0x10).await;
            rig.events_at_least(reasons.len() + 2).await
        })
        .await;
    let mut expected: Vec<_> = (0..)
        .zip(reasons)
        .map(|(token, (_, refusal))| Outcome::Refused(token, refusal))
        .collect();
    expected.push(Outcome::Acknowledged(count));
    assert_eq!(events[1..], expected);
    assert_eq!(rig.counters.refused.get(), count);
}

#[tokio::test]
async fn a_publication_with_a_token_that_cannot_be_sent_is_reported_as_refused() {
    for version in VERSIONS {
        let wild = Publication {
            qos: Qos::AtLeastOnce,
            token: Some(3),
            ..text("a/#", "")
        };
        let stub = Stub::new(version).await;
        let rig = Rig::greeting(vec![ClientPacket::Publish(wild), with_token(4)]);
        let events = rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            let identifier = peer.published().await.identifier;
            peer.acknowledge(identifier).await;
            rig.events_at_least(3).await
        });
        assert_eq!(
            events.await[1..],
            [
                Outcome::Refused(3, PublicationRefusal::Never),
                Outcome::Acknowledged(4)
            ],
            "{version:?}"
        );
    }
}

/// All publications until the client has been quiet for a moment.
async fn until_quiet(peer: &mut Peer) -> Vec<Published> {
    let mut all = Vec::new();
    while let Ok(published) = timeout(Duration::from_millis(200), peer.published()).await {
        all.push(published);
    }
    all
}

#[tokio::test]
async fn no_more_is_open_than_the_broker_takes_at_once() {
    let version = MqttVersion::V5;
    let stub = Stub::new(version).await;
    let rig = Rig::greeting((0..20).map(with_token).collect());
    let events = rig
        .run(&stub, version, async {
            // Receive maximum 3.
            let mut peer = stub.welcome_on(&[0x21, 0, 3]).await;
            let mut open = until_quiet(&mut peer).await;
            assert_eq!(open.len(), 3, "{open:?}");
            // A refusal frees its place as an acknowledgement does.
            let first = open.remove(0);
            answer(&mut peer, first.identifier, 0x97).await;
            let next = until_quiet(&mut peer).await;
            assert_eq!(next.len(), 1, "{next:?}");
            open.extend(next);
            let mut count = 4;
            while count < 20 {
                let first = open.remove(0);
                peer.acknowledge(first.identifier).await;
                open.push(
                    timeout(Duration::from_secs(5), peer.published())
                        .await
                        .expect("the next one"),
                );
                count += 1;
            }
            for it in open {
                peer.acknowledge(it.identifier).await;
            }
            rig.events_at_least(21).await
        })
        .await;
    assert_eq!(events[1], Outcome::Refused(0, PublicationRefusal::Full));
    assert_eq!(acknowledged(&events), (1..20).collect::<Vec<_>>());
}

#[tokio::test]
async fn a_long_subscription_goes_in_pieces_that_a_small_limit_takes_and_is_answered_as_one() {
    for version in VERSIONS {
        let paths: Vec<_> = (0..30)
            .map(|number| format!("site/building/gateway/drive/+/{number}/set"))
            .collect();
        let filters = filters(&paths.iter().map(String::as_str).collect::<Vec<_>>());
        let stub = Stub::new(version).await;
        let rig = Rig::greeting(vec![ClientPacket::Subscribe(filters)]);
        let events = rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            let mut answered = 0;
            while answered < paths.len() {
                let subscribe = peer.expect(SUBSCRIBE).await;
                assert!(subscribe.body.len() < 500, "{}", subscribe.body.len());
                let here = subscribe.body.windows(4).filter(|at| at == b"/set").count();
                let codes: Vec<_> = (answered..answered + here)
                    .map(|at| if at == 7 { 0x80 } else { 1 })
                    .collect();
                peer.answer_subscribe(&subscribe, &codes).await;
                answered += here;
            }
            rig.events_at_least(2).await
        });
        let expected = (0..paths.len()).map(|at| at != 7).collect();
        assert_eq!(
            events.await[1..],
            [Outcome::Subscribed(expected)],
            "{version:?}"
        );
    }
}
