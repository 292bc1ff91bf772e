//! Macros for the tasks of an application: [`tasks!`](crate::tasks!), [`server!`](crate::server!) and
//! [`client!`](crate::client!).

/// Defines tasks, and the [`Roll`](crate::Roll) that they sign.
///
/// ```text
/// multidrop::tasks! {
///     /// The tasks that have to be alive.
///     static ROLL: Roll<Irqs>;
///
///     fn receive(port: &'static ServerPort<Rs485>) = multidrop::receive(port);
///     fn serve(port: &'static ServerPort<Rs485>, model: &'static Model) = multidrop::serve(port, model);
///     fn blink(mut led: Output<PB5>) = async move {
///         loop {
///             led.toggle();
///             Timer::after_millis(500).await;
///         }
///     };
/// }
/// ```
///
/// Behind `=` stands the future that the task runs for ever. What a temporary in it holds lives as long as the task. Each task has
/// the place on the roll in which it stands here, so that none is forgotten and none signs for another. `Roll<...>` names the
/// board's watchdog.
///
/// Each becomes an `#[embassy_executor::task]`, which is spawned as `spawner.spawn(receive(port).unwrap())`: the crate that uses this
/// needs `embassy-executor`.
#[macro_export]
macro_rules! tasks {
    (
        $(#[$roll_attribute:meta])*
        $vis:vis static $roll:ident: Roll<$watchdog:ty>;
        $(
            $(#[$attribute:meta])*
            fn $task:ident($($argument:tt)*) = $future:expr;
        )+
    ) => {
        /// The places of the tasks on their roll.
        #[allow(non_camel_case_types, clippy::upper_case_acronyms, dead_code)]
        enum $roll { $($task),+ }

        $(#[$roll_attribute])*
        $vis static $roll: $crate::Roll<$watchdog, { [$(stringify!($task)),+].len() }> =
            $crate::Roll::new();

        $(
            $(#[$attribute])*
            #[::embassy_executor::task]
            async fn $task($($argument)*) -> ! {
                $crate::signed(|task| $roll.sign::<{ $roll::$task as usize }>(task), $future).await
            }
        )+
    };
    ($($wrong:tt)*) => {
        compile_error!(
            "tasks! is written `static ROLL: Roll<WATCHDOG>;`, then for each task `fn NAME(ARGUMENTS) = FUTURE;`"
        );
    };
}

/// Defines the two tasks of a port that is a server, their roll, and what spawns them.
///
/// ```text
/// multidrop::server! {
///     static ROLL: Roll<Irqs>;
///     fn server(line: Rs485, PORT) = DemoUnit::new(outputs());
/// }
/// ```
///
/// Named are the roll, with the board's watchdog; the type of the line; the [`PortConfig`](crate::PortConfig); and behind `=` the
/// data model, which is built in its task. It defines the tasks `receive` and `serve`, and `server(line)`, which is what the board's
/// `run` asks for: `board_nano::run(&ROLL, server(line))`. To be called once.
///
/// An application with tasks of its own, or one that shares the model with them, uses [`tasks!`](crate::tasks!). The crate that uses
/// this needs `embassy-executor` and `static_cell`.
#[macro_export]
macro_rules! server {
    (
        $(#[$roll_attribute:meta])*
        static $roll:ident: Roll<$watchdog:ty>;
        $(#[$attribute:meta])*
        fn $start:ident(line: $line:ty, $config:expr) = $model:expr;
    ) => {
        $crate::tasks! {
            $(#[$roll_attribute])*
            static $roll: Roll<$watchdog>;

            fn receive(port: &'static $crate::ServerPort<$line>) = $crate::receive(port);
            fn serve(port: &'static $crate::ServerPort<$line>) =
                $crate::serve(port, &$crate::Shared::new($model));
        }

        $(#[$attribute])*
        #[inline(always)]
        fn $start(line: $line) -> impl FnOnce(::embassy_executor::Spawner) {
            static SERVER_PORT_CELL: ::static_cell::StaticCell<$crate::ServerPort<$line>> =
                ::static_cell::StaticCell::new();
            let port = SERVER_PORT_CELL.init($crate::ServerPort::new(line, &$config));
            move |spawner| {
                spawner.spawn(receive(port).unwrap());
                spawner.spawn(serve(port).unwrap());
            }
        }
    };
    ($($wrong:tt)*) => {
        compile_error!(
            "server! is written `static ROLL: Roll<WATCHDOG>; fn server(line: LINE, PORT_CONFIG) = MODEL;`"
        );
    };
}

/// Defines the two tasks of a port that is a client, their roll, and what spawns them.
///
/// ```text
/// multidrop::client! {
///     static ROLL: Roll<Irqs>;
///     fn client(line: Rs485, ClientConfig::new()) = copy;
/// }
///
/// async fn copy(client: Client<Rs485, 1>) -> ! { ... }
/// ```
///
/// Named are the roll, with the board's watchdog; the type of the line; the [`ClientConfig`](crate::ClientConfig); and behind `=` the
/// function that asks. It defines the tasks `receive` and `ask`, and `client(line)`, which is what the board's `run` asks for:
/// `board_nano::run(&ROLL, client(line))`. To be called once. `ask` waits for times.
///
/// An application with more tasks uses [`tasks!`](crate::tasks!). The crate that uses this needs `embassy-executor` and `static_cell`.
#[macro_export]
macro_rules! client {
    (
        $(#[$roll_attribute:meta])*
        static $roll:ident: Roll<$watchdog:ty>;
        $(#[$attribute:meta])*
        fn $start:ident(line: $line:ty, $config:expr) = $run:expr;
    ) => {
        $crate::tasks! {
            $(#[$roll_attribute])*
            static $roll: Roll<$watchdog>;

            fn receive(port: &'static $crate::ClientPort<$line, 1>) = $crate::client_receive(port);
            fn ask(client: $crate::Client<$line, 1>) = $run(client);
        }

        $(#[$attribute])*
        #[inline(always)]
        fn $start(line: $line) -> impl FnOnce(::embassy_executor::Spawner) {
            static CLIENT_PORT_CELL: ::static_cell::StaticCell<$crate::ClientPort<$line, 1>> =
                ::static_cell::StaticCell::new();
            let port: &'static _ = CLIENT_PORT_CELL.init($crate::ClientPort::new(line));
            move |spawner| {
                spawner.spawn(receive(port).unwrap());
                spawner.spawn(ask(port.client($config)).unwrap());
            }
        }
    };
    ($($wrong:tt)*) => {
        compile_error!(
            "client! is written `static ROLL: Roll<WATCHDOG>; fn client(line: LINE, CLIENT_CONFIG) = FUNCTION;`"
        );
    };
}
