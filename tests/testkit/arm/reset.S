@ Counts its starts at 0x20000000, keeps RCC's CSR of each from 0x20000010 on, and clears its flags. Then, at the first start, FIRST says what: 1 an
@ undefined instruction, 2 a load from nowhere, 3 the watchdog with RELOAD and PRESCALER, which is not fed, 4 the same, fed
@ FEEDS times, 5 an access to what is not modelled, 6 a stack that grows into 32 bytes where the
@ memory protection unit allows nothing. The handler of faults keeps CFSR at 0x20000004 and resets the chip.
 .syntax unified
 .cpu cortex-m4
 .thumb
 .section .vectors,"a"
 .word 0x20010000
 .word reset + 1
 .word 0
 .word fault + 1

 .text
reset:
 ldr r4, =0x20000000
 ldr r5, [r4]
 ldr r0, =0x40023800    @ RCC
 ldr r1, [r0, #0x74]    @ CSR
 add r2, r4, #0x10
 str r1, [r2, r5, lsl #2]
 ldr r1, =1 << 24       @ RMVF
 str r1, [r0, #0x74]
 add r5, #1
 str r5, [r4]
 cmp r5, #1
 bne stop
 mov r0, #FIRST
 tbb [pc, r0]
table:
 .byte (stop - table) / 2, (undefined - table) / 2, (nowhere - table) / 2, (watchdog - table) / 2, (watchdog - table) / 2, (unknown - table) / 2, (grow - table) / 2
 .align 1
undefined:
 udf #0
grow:
 ldr r0, =0xE000ED98    @ MPU: RNR, RBAR, RASR
 mov r1, #0
 str r1, [r0]
 ldr r1, =0x2000F000
 str r1, [r0, #4]
 ldr r1, =0x10000009    @ XN, no access, 32 bytes, on
 str r1, [r0, #8]
 mov r1, #5             @ PRIVDEFENA, ENABLE
 str r1, [r0, #-4]      @ CTRL
1: push {r0-r3}
 b 1b
nowhere:
 ldr r0, =0x30000000
 ldr r0, [r0]
unknown:
 ldr r0, =0x40012000    @ ADC1
 ldr r0, [r0]
watchdog:
 ldr r0, =0x40003000    @ IWDG
 ldr r1, =0x5555
 str r1, [r0]
 ldr r1, =PRESCALER
 str r1, [r0, #4]
 ldr r1, =RELOAD
 str r1, [r0, #8]
 ldr r1, =0xCCCC
 str r1, [r0]
 ldr r3, =FEEDS
 cbz r3, stop
feed:
 ldr r2, =40000         @ 10 ms at 16 MHz: 4 clocks a loop
1: subs r2, #1
 bne 1b
 ldr r1, =0xAAAA
 str r1, [r0]
 subs r3, #1
 bne feed
stop:
 wfi
 b stop

fault:
 ldr r0, =0xE000ED28    @ CFSR
 ldr r1, [r0]
 ldr r0, =0x20000004
 str r1, [r0]
 ldr r0, =0xE000ED0C    @ AIRCR
 ldr r1, =0x05FA0004
 str r1, [r0]
 b .
